"""Checkpoints: the whole state of a run in one folder, written atomically.

A checkpoint is a nested dictionary of arrays and plain data: the arrays in `arrays.safetensors`, the rest in
`state.json`. Loading one can't execute code.
"""

import hashlib
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from thalweg.core.atomic_io import disk_errors_name
from thalweg.train.errors import TrainingError

FORMAT = 1
FOLDER = "checkpoints"
ARRAYS, PLAIN = "arrays.safetensors", "state.json"
KEEP = 2
"""Number of checkpoints to keep: the newest, and the one before it."""
SEPARATOR = "/"
"""Separator of the keys in the name of an array."""


def save_checkpoint(run_folder: Path, step: int, state: dict[str, Any]) -> Path:
    """Write a state as the newest checkpoint of a run and remove old ones; returns its folder.

    Raises `TrainingError` for a state that holds anything but arrays and plain data.
    """
    arrays = dict(_arrays(state))
    content = save(arrays)
    digest = hashlib.sha256(content).hexdigest()
    try:
        plain = json.dumps({"format": FORMAT, "step": step, "sha256": digest, "state": _plain(state)}).encode()
    except TypeError as error:
        raise TrainingError(f"a checkpoint holds arrays and plain data only: {error}") from error
    parent = run_folder / FOLDER
    parent.mkdir(parents=True, exist_ok=True)
    partial, final = parent / f".{step:012d}.{os.getpid()}.part", parent / f"{step:012d}"
    shutil.rmtree(partial, ignore_errors=True)
    try:
        with disk_errors_name(final):
            partial.mkdir()
            for name, data in ((ARRAYS, content), (PLAIN, plain)):
                _write_synced(partial / name, data)
    except OSError:
        shutil.rmtree(partial, ignore_errors=True)  # a full disk needs the space
        raise
    shutil.rmtree(final, ignore_errors=True)
    os.rename(partial, final)
    for old in _complete(parent)[:-KEEP]:
        shutil.rmtree(old, ignore_errors=True)
    for leftover in parent.glob(".*.part"):  # of writers that were killed
        shutil.rmtree(leftover, ignore_errors=True)
    return final


def _write_synced(path: Path, data: bytes) -> None:
    with open(path, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def load_checkpoint(run_folder: Path) -> tuple[int, dict[str, Any]] | None:
    """Return step and state of the newest checkpoint of a run, or None; raises `TrainingError` if it is damaged."""
    checkpoints = _complete(run_folder / FOLDER)
    if not checkpoints:
        return None
    folder = checkpoints[-1]
    try:
        content = (folder / ARRAYS).read_bytes()
        plain = json.loads((folder / PLAIN).read_bytes())
        if not isinstance(plain, dict) or not isinstance(plain["state"], dict) or type(plain["step"]) is not int:
            raise TrainingError(f"{folder} is not a checkpoint: {PLAIN} must hold a step and a state")
        if plain["format"] != FORMAT:
            raise TrainingError(f"{folder} is a checkpoint of format {plain['format']}, this version reads {FORMAT}")
        if hashlib.sha256(content).hexdigest() != plain["sha256"]:
            raise TrainingError(f"{folder} is damaged: its arrays are not those that were written")
        return plain["step"], _insert(load(content), plain["state"])
    except TrainingError:
        raise
    except (OSError, ValueError, KeyError, TypeError, RecursionError, SafetensorError) as error:
        raise TrainingError(
            f"{folder} is not a complete checkpoint ({error}); remove it to resume from the one before"
        ) from error


def newest_step(run_folder: Path) -> int | None:
    """Return the step of the newest checkpoint of a run, from which it resumes; None if there is none."""
    checkpoints = _complete(run_folder / FOLDER)
    return int(checkpoints[-1].name) if checkpoints else None


def _complete(parent: Path) -> list[Path]:
    """Return the folders of complete checkpoints, oldest first."""
    return sorted(path for path in parent.glob("[0-9]*") if path.name.isdecimal() and path.is_dir())


def _arrays(state: dict[str, Any], path: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Yield name and value of all arrays in a nested state; a name is the path of its keys."""
    for key, value in state.items():
        if not isinstance(key, str) or SEPARATOR in key:
            raise TrainingError(f"a key of a checkpoint is a string without {SEPARATOR!r}, got {key!r}")
        if isinstance(value, dict):
            yield from _arrays(value, f"{path}{key}{SEPARATOR}")
        elif isinstance(value, np.ndarray):
            if value.dtype.kind not in "biuf":
                raise TrainingError(f"{path}{key} is an array of {value.dtype}; a checkpoint holds numbers only")
            yield f"{path}{key}", np.array(value, order="C")


def _plain(state: dict[str, Any]) -> dict[str, Any]:
    """Return a nested state without its arrays."""
    return {
        key: _plain(value) if isinstance(value, dict) else value
        for key, value in state.items()
        if not isinstance(value, np.ndarray)
    }


def _insert(arrays: dict[str, np.ndarray], plain: dict[str, Any]) -> dict[str, Any]:
    """Insert arrays into the nested plain data they were taken from; returns it."""
    for name, array in arrays.items():
        *parents, last = name.split(SEPARATOR)
        parent = plain
        for key in parents:
            parent = parent[key]
        parent[last] = array
    return plain
