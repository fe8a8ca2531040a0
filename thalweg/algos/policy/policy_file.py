"""Policy files: tensors in safetensors format, with JSON in the header, so that loading can't execute code."""

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import safe_open
from safetensors.numpy import save

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.state import CPU, new_generator
from thalweg.core.atomic_io import write_atomic
from thalweg.core.plugins.lookup import find
from thalweg.core.plugins.record import PluginError

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
    except Exception as error:  # also for types of numbers that NumPy lacks, and for JSON nested too deep
        raise AlgorithmError(
            f"{path} is no policy file, such as policy.safetensors in a run's folder, or a damaged one: {error}"
        ) from error
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        version = header.get("format") if isinstance(header, dict) else "none"
        raise AlgorithmError(f"{path} holds a policy of format {version}, this version reads {FORMAT}")
    if not isinstance(header.get("kind"), str):
        raise AlgorithmError(f"{path} holds a policy of the kind {header.get('kind')!r:.40}: a name is needed")
    if header["kind"] not in LOADERS:
        _load_plugin(path, header)
    for name, tensor in tensors.items():
        if not np.isfinite(tensor).all():
            raise AlgorithmError(f"{path}: the tensor {name} holds numbers that are not finite")
    try:
        about = About(header["algorithm"], header["config"], header["context"])
        _check_about(about)
        return LOADERS[header["kind"]](header, tensors, about, new_generator(device))
    except PluginError:
        raise
    except AlgorithmError as error:
        raise AlgorithmError(f"{path}: {error}") from error
    except (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError) as error:
        raise AlgorithmError(f"the tensors of {path} do not match its header: {error}") from error


def _check_about(about: About) -> None:
    """Raise `TypeError` for an origin of other types than `About` says."""
    for what, value, kind in (
        ("algorithm", about.algorithm, str),
        ("config", about.config, dict),
        ("context", about.context, dict),
    ):
        if not isinstance(value, kind):
            raise TypeError(f"{what} is {value!r:.40}")


def whole_number(header: dict[str, Any], key: str) -> int:
    """Return a number of a header that is at least 1; raises `AlgorithmError` for anything else."""
    value = header[key]
    if type(value) is not int or value < 1:
        raise AlgorithmError(f"{key} must be a whole number of at least 1, got {value!r:.40}")
    return value


def check_size(
    inputs: int, hidden: Sequence[int], outputs: int, tensors: Mapping[str, np.ndarray], copies: int = 1
) -> None:
    """Raise `AlgorithmError` if copies of a network of these layers have more weights than the tensors have numbers.

    It is checked before the network is made: a wrong size in a header must not fill the memory.
    """
    layers = [inputs, *hidden, outputs]
    if any(type(size) is not int or size < 1 for size in (*layers, copies)):
        raise AlgorithmError(f"a network of layers {layers!s:.80}: whole numbers of at least 1 are needed")
    needed, found = copies * sum(a * b for a, b in pairwise(layers)), sum(tensor.size for tensor in tensors.values())
    if needed > found:
        raise AlgorithmError(f"shapes of {needed:,} weights, but there are {found:,} numbers in the tensors")


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
