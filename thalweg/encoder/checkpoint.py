"""Checkpoints of a training of an encoder: model and Adam as tensors by name, and the folder of another training."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from thalweg.core.run_folder import CPU, DEVICE, FolderKind
from thalweg.encoder.files import FORMAT, EncoderFileError, read_tensors, write_tensors

ADAM = "adam."
"""Prefix of the names of Adam's moments."""
ANEW = "train in a new folder"
OPTIONAL = ("camera", "quality", "randomise", "world_seeds")
"""What a run may say of its frames; it is absent where they are as usual."""
LATER = ("level", "world_seeds", "river")
"""What trainings of autoencoders say of their rivers; older ones said nothing."""
VERSION = "_version"
"""Ending of the keys of versions in what a run says of itself."""
Row = dict[str, float | None]
"""An epoch: its row of metrics.csv."""


def state_tensors(model: nn.Module, prefix: str, optimizer: torch.optim.Adam) -> dict[str, Tensor]:
    """Return the tensors of a model, their names after `prefix`, and the moments of its optimizer."""
    tensors = {f"{prefix}{name}": tensor for name, tensor in model.state_dict().items()}
    for index, moments in optimizer.state_dict()["state"].items():
        tensors |= {f"{ADAM}{index}.{name}": tensor for name, tensor in moments.items()}
    return tensors


def save_state(
    path: Path, kind: str, run: Mapping[str, Any], rows: Sequence[Row], tensors: Mapping[str, Tensor]
) -> None:
    """Write what the next epoch needs, see `state_tensors`, and the rows so far to one file, atomically."""
    write_tensors(path, dict(tensors), {"kind": kind, "format": FORMAT, "run": dict(run), "rows": list(rows)})


def resume_state(
    path: Path,
    kind: FolderKind,
    columns: Sequence[str],
    run: Mapping[str, Any],
    model: nn.Module,
    prefix: str,
    optimizer: torch.optim.Adam,
) -> list[Row]:
    """Restore model and optimiser from a checkpoint and return its rows; without a file, return no rows.

    Raises `EncoderFileError` for the checkpoint of another run than `run`, or a damaged one.
    """
    if not path.exists():
        return []
    tensors, rows, recorded = read_checkpoint(path, kind.owner, columns)
    require_same_run(path.parent, kind, recorded, run)
    restore_state(path, tensors, model, prefix, optimizer)
    return rows


def read_checkpoint(path: Path, kind: str, columns: Sequence[str]) -> tuple[dict[str, Tensor], list[Row], Any]:
    """Return the tensors of a checkpoint, the rows of its finished epochs, and what the run in it says of itself.

    `columns` are those of a row: numbers, of which some may be null. Raises `EncoderFileError`, with the path, for
    anything else.
    """
    tensors, about = read_tensors(path, kind)
    rows, run = about.get("rows"), about.get("run", {})
    if not isinstance(run, Mapping):
        raise EncoderFileError(f"{path}: its run is {run!r:.40}, not a mapping; {ANEW}")
    if not isinstance(rows, list):
        raise EncoderFileError(f"{path}: its epochs are {rows!r:.40}, not a list; {ANEW}")
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, dict) or not all(_is_number(row.get(name, ...)) for name in columns):
            raise EncoderFileError(f"{path}: its epoch {number} lacks a number of {', '.join(columns)}; {ANEW}")
        if row["epoch"] != number:
            raise EncoderFileError(f"{path}: its epoch {number} is called {row['epoch']!r:.40}; {ANEW}")
    for name, tensor in tensors.items():
        if not torch.isfinite(tensor).all():
            raise EncoderFileError(f"{path}: tensor {name} holds numbers that are not finite; {ANEW}")
    return tensors, rows, run


def _is_number(value: Any) -> bool:
    """Return whether a cell of a row is a number that is finite as far as it is there, or null."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    # An integer of any length is compared with a float exactly.
    return value is None or (number and abs(value) <= sys.float_info.max)


def restore_state(
    path: Path, tensors: Mapping[str, Tensor], model: nn.Module, prefix: str, optimizer: torch.optim.Adam
) -> None:
    """Restore what `state_tensors` returned; raises `EncoderFileError`, with the path, for another model's tensors."""
    moments: dict[int, dict[str, Tensor]] = {}
    own = {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
    try:
        for name, tensor in tensors.items():
            if name.startswith(ADAM):
                _, index, moment = name.split(".")
                moments.setdefault(int(index), {})[moment] = tensor
        weights = sum(len(group["params"]) for group in optimizer.param_groups)
        if sorted(moments) != list(range(weights)):
            raise ValueError(f"it has Adam's moments of {len(moments)} weights, of {weights} that there are")
        model.load_state_dict(own)
        optimizer.load_state_dict({**optimizer.state_dict(), "state": moments})
        _restore_memory_layout(optimizer)
    except (RuntimeError, ValueError, KeyError, TypeError) as error:
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
        if not isinstance(recorded := about.get("run", {}), Mapping):
            raise EncoderFileError(f"{path}: its run is {recorded!r:.40}, not a mapping; {ANEW}")
        require_same_run(folder, kind, recorded, run)


def require_same_run(folder: Path, kind: FolderKind, recorded: Mapping[str, Any], run: Mapping[str, Any]) -> None:
    """Raise `EncoderFileError`, naming the first differences, unless the training in a folder is the one of `run`.

    What neither `run` nor `OPTIONAL` names is not compared, nor is what an older training did not record.
    """
    older = () if any(key in recorded for key in ("level", "levels", "river")) else LATER
    recorded = {DEVICE: CPU, **recorded}
    kept = {key: recorded[key] for key in (*run, *OPTIONAL) if key in recorded}
    asked = {key: value for key, value in run.items() if key in recorded or not (key.endswith(VERSION) or key in older)}
    kind.require_same(folder, kept, asked)


def _restore_memory_layout(optimizer: torch.optim.Adam) -> None:
    """Give Adam's moments the memory layout of their weights, which the fused step assumes."""
    for weight, moments in optimizer.state.items():
        if moments["step"].numel() != 1:
            raise ValueError(f"Adam's steps are {moments['step'].numel()} numbers, not one")
        for name in ("exp_avg", "exp_avg_sq"):
            if moments[name].shape != weight.shape:
                raise ValueError(f"Adam's {name} has shape {tuple(moments[name].shape)}, not {tuple(weight.shape)}")
            moments[name] = torch.empty_like(weight).copy_(moments[name])
