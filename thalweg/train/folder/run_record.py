"""Record of a run in its folder: its settings (config.yaml) and its status (status.json)."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from thalweg.core.atomic_io import write_atomic
from thalweg.core.machine import gpu_info, machine_info, package_versions
from thalweg.train.errors import TrainingError

CONFIG, STATUS, POLICY = "config.yaml", "status.json", "policy.safetensors"
MOST_NAMED = 4
"""Maximum number of differences or files that an error message lists."""


def describe(identity: dict[str, Any], threads: int) -> dict[str, Any]:
    """Content of config.yaml: the settings of a run, and the versions, device and machine that it runs on."""
    device = identity.get("device", "cpu")
    return {
        "run": identity,
        "versions": package_versions(),
        "device": device,
        "machine": machine_info() | {"learning_threads": threads} | (gpu_info() if device == "cuda" else {}),
    }


def write_config(folder: Path, description: dict[str, Any]) -> None:
    """Write config.yaml; raises `TrainingError` for anything but plain data, before the folder is created."""
    write_atomic(folder / CONFIG, _yaml(description))


def read_config(folder: Path) -> dict[str, Any] | None:
    """Content of config.yaml, or None if a run can start in the folder because it is missing or empty.

    Raises `TrainingError` for a folder that holds other files (hidden ones do not count), and for a config.yaml that is
    not of a run.
    """
    path = folder / CONFIG
    if not path.exists():
        _require_empty(folder)
        return None
    try:
        description = yaml.safe_load(path.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise TrainingError(f"{path} is not the config of a run: {error}") from error
    if not isinstance(description, dict) or "run" not in description:
        raise TrainingError(f"{path} is not the config of a run")
    return description


def _require_empty(folder: Path) -> None:
    if folder.exists() and not folder.is_dir():
        raise TrainingError(f"{folder} is a file; give a new folder for the run")
    found = sorted(path.name for path in folder.glob("[!.]*"))
    if found:
        more = f" and {len(found) - MOST_NAMED} more" if len(found) > MOST_NAMED else ""
        raise TrainingError(
            f"{folder} holds {', '.join(found[:MOST_NAMED])}{more}, but no {CONFIG}: it is not the folder of a run. "
            f"Give a new or empty one, such as {folder / 'NAME'}"
        )


def require_same(place: Path, theirs: dict[str, Any], ours: dict[str, Any]) -> None:
    """Raise `TrainingError` with the differences between the run that `place` belongs to and the requested one."""
    there, here = dict(_flat(theirs)), dict(_flat(_plain(ours)))
    different = [
        f"{key} is {there.get(key, 'absent')!r} there and {here.get(key, 'absent')!r} here"
        for key in {**there, **here}
        if there.get(key, "absent") != here.get(key, "absent")
    ]
    if different:
        # Another algorithm differs in every setting, so only the first differences are listed.
        more = f"; and {len(different) - MOST_NAMED} more" if len(different) > MOST_NAMED else ""
        named = "; ".join(different[:MOST_NAMED])
        raise TrainingError(f"{place} belongs to another run: {named}{more}. Choose another folder.")


def write_status(folder: Path, status: dict[str, Any]) -> None:
    """Write status.json; `state` is running, finished, interrupted or failed. An unknown value (NaN) becomes null."""
    known = {name: None if value != value else value for name, value in status.items()}
    write_atomic(folder / STATUS, json.dumps(known, indent=1, allow_nan=False) + "\n")


def read_status(folder: Path) -> dict[str, Any]:
    """Content of status.json; empty if there is none."""
    path = folder / STATUS
    if not path.exists():
        return {}
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise TrainingError(f"{path} is not the status of a run: {error}") from error


def _plain(data: Any) -> Any:
    """Data as it reads back from YAML: tuples become lists."""
    return yaml.safe_load(_yaml(data))


def _yaml(data: Any) -> str:
    try:
        return yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
    except yaml.YAMLError as error:
        raise TrainingError(f"config and context hold plain data only: {error}") from error


def _flat(data: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in data.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
