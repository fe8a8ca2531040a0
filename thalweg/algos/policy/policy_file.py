"""Policy files: tensors in safetensors format, with JSON in the header, so that loading can't execute code."""

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.state import CPU, new_generator
from thalweg.core.atomic_io import write_atomic
from thalweg.core.plugins.lookup import find

FORMAT = 2
"""Version of the policy file."""
HEADER = "thalweg_policy"
"""Key of the JSON in the header."""


@dataclass(frozen=True)
class About:
    """Origin of a policy; stored in its file and not used to act."""

    algorithm: str = ""
    config: dict[str, Any] = field(default_factory=dict)
    context: dict[str, Any] = field(default_factory=dict)
    """Any plain data, such as the encoder's name, the renderer's version, or scores."""


Loader = Callable[[dict[str, Any], dict[str, np.ndarray], About, torch.Generator], Any]
LOADERS: dict[str, Loader] = {}
"""Function that constructs each kind of policy from header, tensors and origin, on a generator's device. The modules
that define the policies register them here."""


def save_policy(path: str | Path, header: dict[str, Any], tensors: dict[str, np.ndarray], about: About) -> None:
    """Write a policy file atomically; `header` is plain data whose "kind" names the loader."""
    content = {"format": FORMAT, **header, **dataclasses.asdict(about)}
    write_atomic(path, save(tensors, {HEADER: json.dumps(content)}))


def load_policy(path: str | Path, device: torch.device = CPU) -> Any:
    """Return the policy of a file, on a device.

    Raises `AlgorithmError` for a file that is missing, damaged or of another version.
    """
    path = Path(path)
    if not path.is_file():
        raise AlgorithmError(f"there is no policy at {path}: give a run's folder or a policy file")
    try:
        with safe_open(path, framework="numpy") as file:
            header = json.loads((file.metadata() or {}).get(HEADER, "null"))
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
    except (SafetensorError, json.JSONDecodeError) as error:
        raise AlgorithmError(f"{path} is not a complete policy file: {error}") from error
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        version = header.get("format") if isinstance(header, dict) else "none"
        raise AlgorithmError(f"{path} holds a policy of format {version}, this version reads {FORMAT}")
    if header.get("kind") not in LOADERS:
        _load_plugin(path, header)
    try:
        about = About(header["algorithm"], header["config"], header["context"])
        return LOADERS[header["kind"]](header, tensors, about, new_generator(device))
    except (KeyError, RuntimeError, TypeError) as error:
        raise AlgorithmError(f"the tensors of {path} do not match its header: {error}") from error


def _load_plugin(path: Path, header: dict[str, Any]) -> None:
    """Load the plug-in of a policy's algorithm, which registers the loader of its kind of policy.

    Raises `AlgorithmError` if there is none, and `PluginError` if it cannot be loaded.
    """
    algorithm = str(header.get("algorithm"))
    if find("thalweg.algorithms", algorithm) is None or header.get("kind") not in LOADERS:
        raise AlgorithmError(
            f"{path} holds a policy of the kind {header.get('kind')!r}, of the algorithm {algorithm!r}, which does not"
            " come with the package: name the plug-in that loads it, such as --plugin mine.py"
        )


def tensors_of(tensors: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    """Return the tensors whose names begin with a prefix and a dot, by the rest of their names."""
    return {name.removeprefix(f"{prefix}."): value for name, value in tensors.items() if name.startswith(f"{prefix}.")}
