"""Record of a run in its folder: its settings (config.yaml) and its status (status.json)."""

import json
import math
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from thalweg.algos.policy import fast_path
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.core.machine import gpu_info, machine_info, package_versions
from thalweg.core.run_folder import CPU, DEVICE, FolderKind
from thalweg.core.yaml12 import load
from thalweg.train.errors import TrainingError
from thalweg.train.folder.checkpoint import SEPARATOR

CONFIG, STATUS, POLICY = "config.yaml", "status.json", "policy.safetensors"
PLUGIN = "plugin"
"""Key of a context: version and source of the plug-in that a policy was trained by."""
ENCODER_FILE = "encoder_file"
"""Key of a context: the encoder's file, where it is not that of the package. Its identity is its hash."""
ENCODER_PLUGIN = "encoder_plugin"
"""Key of a context: version and source of the plug-in that the encoder is, known by name and version."""
TASK_PLUGIN = "task_plugin"
"""Key of a context: version and source of the plug-in that the task is."""
RECORDINGS, RECORDED_DIGEST = "recordings", "recorded_digest"
"""Keys of a context: names of the folders of the recordings that were learnt from, and the hash of their content,
which is their identity."""
PLUGINS = (PLUGIN, ENCODER_PLUGIN, TASK_PLUGIN)
"""Keys of a context for plug-ins: the algorithm, the encoder and the task."""
MADE_WITH = "made_with"
"""Key of config.yaml: versions of what the numbers of a run depend on beside those in its context."""
RECORDED_LATER = ("privileged", "vehicles")
"""Of these, versions that older folders do not have, although nothing has changed since: where they lack, they pass."""
CONTEXT_MAPPINGS = (*PLUGINS, "env", "river")
"""Keys of a context that are mappings."""
MAPPINGS = (
    ("run",),
    ("versions",),
    (MADE_WITH,),
    ("machine",),
    *(("run", "context", key) for key in CONTEXT_MAPPINGS),
)
"""Parts of config.yaml that are mappings where they are there."""
STATUS_NUMBERS = ("steps", "episodes", "return_mean", "cost_mean", "cost_rate", "seconds")
"""Numbers of status.json, null where there is none."""
RUN_FOLDER = FolderKind("run", CONFIG, TrainingError, ignores_hidden=True)


def device_identity(kind: str) -> dict[str, Any]:
    """Return the entry of a run's identity for a kind of device, such as cuda; empty for the CPU."""
    return {} if kind == CPU else {DEVICE: kind}


def made_with(identity: dict[str, Any], learner: Mapping[str, int]) -> dict[str, int]:
    """Return the versions of what the numbers of a run depend on beside those in its context: of its learner by name
    (empty where the context has it), the training loop, on a river its world and its rules, and the ideal eye where
    critics or predictions are told what it sees; of a boat, vehicles; and in a task beside the paper's, or where
    critics of costs are told more than the observation, deadlines."""
    rules, settings = identity.get("context", {}).get("env"), identity.get("config", {})
    made = {**learner, "training": versions.TRAINING}
    if rules is not None:
        made |= {"rules": versions.RULES, "world": versions.WORLD}
        if "critic_size" in identity or settings.get("auxiliary_weight"):
            made["privileged"] = versions.PRIVILEGED
        if rules.get("vehicle", "uav") != "uav":
            made["vehicles"] = versions.VEHICLES
    is_other_task = (rules or {}).get("task", "River") != "River"
    if is_other_task or ("critic_size" in identity and "cost_limit" in settings):
        made["deadlines"] = versions.DEADLINES
    return made


def describe(
    identity: dict[str, Any], threads: int, learner: Mapping[str, int], gpu: str | None = None
) -> dict[str, Any]:
    """Return the content of config.yaml: the run's identity, versions, device and machine, with what the last bits
    depend on beside it; `learner` as of `made_with`, `gpu` as of `gpu_info`, for a run that is on one."""
    device = identity.get(DEVICE, CPU)
    learning = {"learning_threads": threads, "fast_path": fast_path.enabled()}
    return {
        "run": identity,
        "versions": package_versions(),
        MADE_WITH: made_with(identity, learner),
        "device": device,
        "machine": machine_info() | learning | (gpu_info(gpu) if device == "cuda" else {}),
    }


def check_context(context: Mapping[str, Any]) -> None:
    """Raise `TrainingError` for a context that checkpoints, or config.yaml when it is read back, cannot hold."""
    try:
        json.dumps(context, allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise TrainingError(f"context holds plain data only, as JSON has it: {error}") from error
    for key in _keys(context):
        if not isinstance(key, str) or SEPARATOR in key:
            raise TrainingError(f"keys of context must be strings without {SEPARATOR!r}, got {key!r}")
    try:
        load(config_text(dict(context)), yaml.SafeLoader)
    except yaml.YAMLError as error:
        raise TrainingError(f"context cannot be read back from config.yaml: {error}") from error
    for key in CONTEXT_MAPPINGS:
        if key in context and not isinstance(context[key], Mapping):
            raise TrainingError(f"context.{key} must be a mapping or left out, got {context[key]!r:.40}")


def _keys(data: Any) -> Iterator[Any]:
    """Yield the keys of all mappings in plain data."""
    if isinstance(data, Mapping):
        yield from data
    for part in data.values() if isinstance(data, Mapping) else data if isinstance(data, list | tuple) else ():
        yield from _keys(part)


def write_config(folder: Path, description: dict[str, Any]) -> None:
    """Write config.yaml; raises `TrainingError` for anything but plain data, before the folder is created."""
    write_atomic(folder / CONFIG, config_text(description))


def read_config(folder: Path) -> dict[str, Any] | None:
    """Return the content of config.yaml, or None if a new run can start in the folder.

    Raises `TrainingError` for a folder with other files that are not hidden, and for another kind of config.yaml.
    """
    if RUN_FOLDER.is_new(folder):
        return None
    path = folder / CONFIG
    try:
        description = load(path.read_text(encoding="utf-8"), yaml.SafeLoader)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise TrainingError(f"{path} is not the config of a run: {error}") from error
    if not isinstance(description, dict) or description.get("run") is None:
        raise TrainingError(f"{path} is not the config of a run: it has no run")
    for keys in MAPPINGS:
        part: Any = description
        for depth, key in enumerate(keys, start=1):
            part = {} if part.get(key) is None else part[key]
            if not isinstance(part, dict):
                raise TrainingError(f"{path} is not the config of a run: {'.'.join(keys[:depth])} must be a mapping")
    return description


def read_context(folder: Path) -> dict[str, Any]:
    """Return the context of the run in a folder, see `thalweg.train.observations`; empty for a new run and for one
    without. Raises the errors of `read_config`."""
    return ((read_config(folder) or {"run": {}})["run"].get("context")) or {}


def require_same(folder: Path, recorded: dict[str, Any], requested: dict[str, Any]) -> None:
    """Raise `TrainingError` naming the first differences between the folder's run and the requested one.

    The hash of an encoder is its identity; where its file lies is none. So it is with recordings. A plug-in's is its
    version; its source is none.
    """
    RUN_FOLDER.require_same(folder, _identity(recorded), _identity(_as_read_from_yaml(requested)))


def plugin_sources(run: dict[str, Any]) -> dict[str, str]:
    """Return the hashes of the sources of the plug-ins of a run, by their names; empty for the package alone."""
    context = run.get("context")
    if not isinstance(context, dict):
        return {}
    names = run["algorithm"], str(context.get("encoder")).partition(" ")[0], context.get("env", {}).get("task")
    return {name: context[key]["source"] for name, key in zip(names, PLUGINS, strict=True) if key in context}


def write_status(folder: Path, status: dict[str, Any]) -> None:
    """Write status.json: `state` is running, finished, interrupted or failed; NaN is written as null."""
    known = {name: None if value != value else value for name, value in status.items()}
    write_atomic(folder / STATUS, json.dumps(known, indent=1, allow_nan=False) + "\n")


def read_status(folder: Path) -> dict[str, Any]:
    """Return the content of status.json; empty if there is no such file. Raises `TrainingError` for another content."""
    path = folder / STATUS
    if not path.exists():
        return {}
    try:
        status = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise TrainingError(f"{path} is not the status of a run: {error}") from error
    if wrong := _status_error(status):
        raise TrainingError(f"{path} is not the status of a run: {wrong}")
    return status


def _status_error(status: Any) -> str:
    """Return what is wrong with the content of status.json; empty for nothing."""
    if not isinstance(status, dict):
        return "it must be a mapping"
    for name in STATUS_NUMBERS:
        value = status.get(name)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if value is not None and not (is_number and abs(value) <= sys.float_info.max):
            return f"{name} must be a number, got {str(value)[:40]}"
    if not isinstance(status.get("warnings", {}), dict):
        return "warnings must be a mapping"
    for name in ("state", "algorithm"):
        if not isinstance(status.get(name, ""), str):
            return f"{name} must be a word, got {status[name]!r:.40}"
    for name, value in status.items():
        if not _is_finite(value):
            return f"{name} holds a number that is not finite"
    if status.get("state") == "finished" and (missing := {*STATUS_NUMBERS, "algorithm", "warnings"} - status.keys()):
        return f"it lacks {', '.join(sorted(missing))}"
    return ""


def _is_finite(value: Any) -> bool:
    """Return whether all numbers of plain data are finite."""
    if isinstance(value, dict | list):
        return all(map(_is_finite, value.values() if isinstance(value, dict) else value))
    return not isinstance(value, float) or math.isfinite(value)


def _identity(run: dict[str, Any]) -> dict[str, Any]:
    """Return what identifies a run: without the places of its encoder's file and its recordings, and the sources of its
    plug-ins."""
    if not isinstance(context := run.get("context"), dict):
        return run
    places = (ENCODER_FILE, RECORDINGS) if RECORDED_DIGEST in context else (ENCODER_FILE,)
    kept = {key: value for key, value in context.items() if key not in places}
    for plugin in (key for key in PLUGINS if key in kept):
        kept[plugin] = {key: value for key, value in kept[plugin].items() if key != "source"}
    return {**run, "context": kept}


def _as_read_from_yaml(data: dict[str, Any]) -> dict[str, Any]:
    """Return the data as it reads back from YAML: tuples become lists."""
    return yaml.safe_load(config_text(data))


def config_text(data: Any) -> str:
    """Return data as config.yaml has it; raises `TrainingError` for anything but plain data."""
    try:
        return yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
    except yaml.YAMLError as error:
        raise TrainingError(f"config and context hold plain data only: {error}") from error
