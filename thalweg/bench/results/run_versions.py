"""Versions with which each run of a results folder was made: the file `versions.json`.

A run whose versions are not the current ones is outdated. It is trained again if anything that its policy depends on
has changed, and only flown again if nothing but the evaluation has.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.registry import installed_algorithm, plugin_named, version_of
from thalweg.bench.csv_files import ResultsError
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.core.plugins.record import Plugin, PluginError
from thalweg.encoder import encoder_plugin
from thalweg.env.tasks import TASKS, Task, task_plugin
from thalweg.train.observations import FRAMES, PRIVILEGED
from thalweg.train.run import has_asymmetric_critics, tells_cost_critics

FILE = "versions.json"
EVALUATION = "evaluation"
DEFAULT, GEOMETRY, GEOMETRY_TASKS = "default", "geometry", "geometry-tasks"
"""Names of the encoders that come with the package."""
STEADY = "steady"
"""The baseline that teaches imitations, and the name of its version."""
SOURCES = "sources"
"""Key of the hashes of sources of plug-ins, by name, beside the versions of a run; no run is outdated by them alone."""
UNKNOWN = "unknown versions"
"""Label of runs from before versions were recorded."""

Versions = Mapping[str, int | None]
"""Versions by what they are of; None for what this copy of Thalweg lacks."""
Sources = Mapping[str, str]
"""Hashes of the sources of plug-ins, by their names."""


def current_versions(
    kind: str,
    algorithms: Iterable[str],
    *,
    observation: str = FRAMES,
    encoder: str = DEFAULT,
    asymmetric_critics: bool = False,
    told_cost_critics: bool = False,
    begins_with_packaged: bool = False,
    task: str = "River",
    forces: bool = False,
    banks: bool = False,
) -> dict[str, int | None]:
    """The versions that a run of a kind depends on: `train`, `baseline`, `packaged`, or `function` for functions and
    policies that were trained before.

    `algorithms` are those of all stages of its training, or a baseline's name; the version of a function is not among
    them, nor the content of a policy, to which results belong. `observation` is what a trained policy sees: only codes
    of frames depend on the packaged `encoder` of this name, and only the privileged observation does not depend on the
    renderer; `asymmetric_critics` is whether the critics of some stage see the privileged one as well,
    `told_cost_critics` whether critics of costs are among them, and `begins_with_packaged` whether training begins with
    the packaged policy, which sees images; baselines see nothing. Only results of a `task` beside the paper's depend on
    the tasks, where frames show its objects, on these, and where a policy is trained, on deadlines; only those under
    `forces` on wind, current and inertia, and only those of a suite with other `banks` than forest on these.
    """
    flown: dict[str, int | None] = {"world": versions.WORLD, "rules": versions.RULES, EVALUATION: versions.EVALUATION}
    if task != "River":
        flown["tasks"] = versions.TASKS
    if task not in TASKS:
        flown[task] = _version_of_plugin(task)
    if banks:
        flown["banks"] = versions.BANKS
    if forces:
        flown["forces"] = versions.FORCES
    if kind == "baseline":
        return flown | ({STEADY: versions.STEADY} if STEADY in algorithms else {})
    render, coded = {"render": versions.RENDER}, {"encoder": versions.PACKAGED_ENCODER}
    if _task(task).props:
        render["props"] = versions.PROPS
    if encoder != DEFAULT:
        coded = {encoder: _version_of_encoder(encoder)}
    packaged = {"packaged": versions.PACKAGED_POLICY}
    if kind == "packaged":
        return flown | render | packaged
    seen = (render if observation != PRIVILEGED else {}) | (coded if observation == FRAMES else {})
    if observation == PRIVILEGED or asymmetric_critics:
        seen["privileged"] = versions.PRIVILEGED
    if kind == "function":
        return flown | seen
    learning = {name: version_of(name) for name in algorithms}
    if task != "River" or told_cost_critics:
        learning["deadlines"] = versions.DEADLINES
    return flown | seen | (packaged if begins_with_packaged else {}) | {"training": versions.TRAINING} | learning


def _task(name: str) -> Task:
    """The task with a name; one without objects if it is not here, or is broken."""
    try:
        plugin = task_plugin(name)
    except PluginError:
        plugin = None
    return TASKS.get(name, Task()) if plugin is None else plugin.record.task


def some_critics_are_asymmetric(stages: Iterable[tuple[str, Mapping[str, Any], str]]) -> bool:
    """Return whether critics of some stage of training see what the ideal eye does, by algorithm, settings and preset.

    They do not if this copy of Thalweg lacks the algorithm, the preset or a setting.
    """
    return any(has_asymmetric_critics(_config_of(*stage)) for stage in stages)


def some_cost_critics_are_told(stages: Iterable[tuple[str, Mapping[str, Any], str]]) -> bool:
    """Return whether critics of costs are among those of `some_critics_are_asymmetric`."""
    return any(tells_cost_critics(_config_of(*stage)) for stage in stages)


def _config_of(algorithm: str, settings: Mapping[str, Any], preset: str) -> Any:
    """Return the config of a stage of training; None if this copy of Thalweg lacks something of it."""
    entry = installed_algorithm(algorithm)
    try:
        return None if entry is None else entry.configure(dict(settings), preset)
    except AlgorithmError:
        return None


def plugin_of(name: str) -> Plugin | None:
    """The plug-in with a name, of an algorithm, an encoder or a task; None for one of the package, or none at all.

    Raises `PluginError` for one that is broken.
    """
    return plugin_named(name) or encoder_plugin(name) or task_plugin(name)


def current_sources(names: Iterable[str]) -> dict[str, str]:
    """The hashes of the sources of those algorithms, encoders and tasks that are plug-ins; raises `PluginError` for one
    that is broken."""
    plugins = {name: plugin_of(name) for name in names}
    return {name: plugin.source for name, plugin in plugins.items() if plugin is not None}


def _version_of_encoder(name: str) -> int | None:
    """The version of an encoder of geometry of the package, or of a plug-in; None as of `_version_of_plugin`."""
    packaged = {GEOMETRY: versions.PACKAGED_GEOMETRY, GEOMETRY_TASKS: versions.PACKAGED_GEOMETRY_TASKS}
    return packaged[name] if name in packaged else _version_of_plugin(name)


def _version_of_plugin(name: str) -> int | None:
    """The version of an encoder or a task of a plug-in; None for one that is not here, or is broken."""
    try:
        plugin = encoder_plugin(name) or task_plugin(name)
    except PluginError:
        return None
    return None if plugin is None else plugin.record.version


def needs_training(recorded: Versions, current: Versions) -> bool:
    """Whether a trained policy of the versions `recorded` is outdated itself, and not only its flights."""
    return any(recorded.get(name) != version for name, version in current.items() if name != EVALUATION)


def changed_versions(recorded: Versions, current: Versions) -> dict[str, int | None]:
    """Those of the versions `recorded` that differ from the current ones."""
    return {name: version for name, version in recorded.items() if current.get(name) != version}


def added_versions(recorded: Versions, current: Versions) -> dict[str, int | None]:
    """The current versions of what a run did not record, since it was made before there were any."""
    return {name: version for name, version in current.items() if name not in recorded}


def version_label(recorded: Versions, current: Versions) -> str:
    """The versions of an outdated run that differ from the current ones, such as `render 1, PPO 1`; where none does,
    those that it was made before, such as `before deadlines 1`; empty for another run."""
    if recorded == current:
        return ""
    if not recorded:
        return UNKNOWN
    differing = [f"{name} {version}" for name, version in changed_versions(recorded, current).items()]
    return ", ".join(differing or [f"before {name} {new}" for name, new in added_versions(recorded, current).items()])


def read_versions(folder: Path) -> dict[str, Versions]:
    """The versions of each run in a folder of results; empty without `versions.json`.

    Raises `ResultsError` for a file of another kind.
    """
    content = _read(folder)
    return {run: {name: each for name, each in of.items() if name != SOURCES} for run, of in content.items()}


def read_sources(folder: Path) -> dict[str, Sources]:
    """The hashes of the sources of plug-ins that each run was made with; no entry for a run of the package alone.

    Raises `ResultsError` as `read_versions` does.
    """
    return {run: of[SOURCES] for run, of in _read(folder).items() if SOURCES in of}


def _read(folder: Path) -> dict[str, Any]:
    """The content of `versions.json`; empty without the file. Raises `ResultsError` for one of another kind."""
    path = folder / FILE
    if not path.exists():
        return {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ResultsError(f"{FILE} cannot be read: {error}") from error
    if not isinstance(content, dict) or not all(_are_versions(recorded) for recorded in content.values()):
        raise ResultsError(f"{FILE} is not the versions of runs: a mapping of whole numbers is needed for each run")
    return content


def _are_versions(recorded: object) -> bool:
    if not isinstance(recorded, dict):
        return False
    sources = recorded.get(SOURCES, {})
    numbers = (each for name, each in recorded.items() if name != SOURCES)
    texts = sources.values() if isinstance(sources, dict) else [None]
    return all(each is None or type(each) is int for each in numbers) and all(isinstance(each, str) for each in texts)


def write_versions(
    folder: Path, recorded: Mapping[str, Versions], sources: Mapping[str, Sources] | None = None
) -> None:
    """Write `versions.json` atomically, one line for each run; `sources` of plug-ins by run, none by default."""
    lines = []
    for run, made_with in recorded.items():
        of_plugins = {SOURCES: dict(found)} if (found := (sources or {}).get(run)) else {}
        lines.append(f" {json.dumps(run)}: {json.dumps({**made_with, **of_plugins})}")
    write_atomic(folder / FILE, "{\n" + ",\n".join(lines) + "\n}\n")
