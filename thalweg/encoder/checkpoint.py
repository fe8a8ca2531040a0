"""Checkpoints of a training of an encoder: model and Adam as tensors by name, and the folder of another training."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from thalweg.core.run_folder import FolderKind
from thalweg.encoder.files import EncoderFileError, read_tensors

ADAM = "adam."
"""Prefix of the names of Adam's moments."""


def state_tensors(model: nn.Module, prefix: str, optimizer: torch.optim.Adam) -> dict[str, Tensor]:
    """Return the tensors of a model, their names after `prefix`, and the moments of its optimizer."""
    tensors = {f"{prefix}{name}": tensor for name, tensor in model.state_dict().items()}
    for index, moments in optimizer.state_dict()["state"].items():
        tensors |= {f"{ADAM}{index}.{name}": tensor for name, tensor in moments.items()}
    return tensors


def restore_state(
    path: Path, tensors: Mapping[str, Tensor], model: nn.Module, prefix: str, optimizer: torch.optim.Adam
) -> None:
    """Restore what `state_tensors` returned; raises `EncoderFileError`, with the path, for another model's tensors."""
    state = {**optimizer.state_dict(), "state": {}}
    for name, tensor in tensors.items():
        if name.startswith(ADAM):
            _, index, moment = name.split(".")
            state["state"].setdefault(int(index), {})[moment] = tensor
    own = {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
    try:
        model.load_state_dict(own)
        optimizer.load_state_dict(state)
        _restore_memory_layout(optimizer)
    except (RuntimeError, ValueError) as error:
        raise EncoderFileError(f"{path}: the tensors don't fit the model: {error}") from error


def check_folder(folder: Path, kind: FolderKind, run: Mapping[str, Any]) -> None:
    """Raise `EncoderFileError` if the path is a file, or the folder holds a training with other settings than `run`.

    `kind` is that of the training, with the name of its checkpoint and the kind that this says it is.
    """
    if folder.exists() and not folder.is_dir():
        raise EncoderFileError(f"{folder} is not a folder")
    path = folder / kind.record
    if path.exists():
        _, about = read_tensors(path, kind.owner)
        recorded = about.get("run", {})
        kind.require_same(folder, {key: recorded[key] for key in run if key in recorded}, run)


def _restore_memory_layout(optimizer: torch.optim.Adam) -> None:
    """Give Adam's moments the memory layout of their weights, which the fused step assumes."""
    for weight, moments in optimizer.state.items():
        for name in ("exp_avg", "exp_avg_sq"):
            moments[name] = torch.empty_like(weight).copy_(moments[name])
