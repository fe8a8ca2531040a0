"""Reading of a results folder's `suite.json`.

Only the values that are read are checked; another version may have written more.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

from pydantic import model_validator

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.evaluate.rivers import NAME
from thalweg.bench.suite.views import views_in_words
from thalweg.core.config import TupleOf, frozen_config, parse_config
from thalweg.env.task.reward_cost import FULL_COURSE_REWARD
from thalweg.env.tasks import PAPER_TASK, TASKS
from thalweg.world.real.selection import Selection

MOST_SHOWN = 200
"""Characters of a wrong value that an error shows."""


@frozen_config(ResultsError, extra="ignore")
class StageRecord:
    """Record of a `thalweg.bench.suite.arms.Stage`."""

    steps: int
    algorithm: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    preset: str = "default"


@frozen_config(ResultsError, extra="ignore")
class ArmRecord:
    """Record of a `thalweg.bench.suite.arms.Arm`."""

    name: str
    algorithm: str
    seeds: TupleOf[int]
    steps: int
    level: str = ""
    before: TupleOf[StageRecord] = ()
    observation: str | None = None
    encoder: str | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    preset: str = "default"
    begin_with: str | Mapping[str, Any] = ""
    """`packaged`, or file, content and whether it was taught, as `PolicyFile.as_data` writes it; empty for none."""


@frozen_config(ResultsError, extra="ignore")
class ConditionRecord:
    """Record of a `thalweg.bench.evaluate.conditions.Condition`."""

    name: str
    levels: TupleOf[str]
    rivers: Mapping[str, Any]
    """Its real rivers by name, as `thalweg.bench.evaluate.rivers.recorded_reach` writes them."""
    blind: bool

    @model_validator(mode="after")
    def _check(self) -> "ConditionRecord":
        if not NAME.fullmatch(self.name):
            raise ValueError(f"name must be letters, digits, - and ., got {_to_json(self.name)}")
        return self


@frozen_config(ResultsError, extra="ignore")
class FileRecord:
    """Record of a file of a `thalweg.bench.suite.flown.SavedPolicy`."""

    file: str
    content: str


@frozen_config(ResultsError, extra="ignore")
class FlownRecord:
    """Record of a function or a policy of `thalweg.bench.suite.flown`."""

    name: str
    observation: str
    policy: TupleOf[FileRecord] = ()
    """Files of a policy that was trained before; none of a function."""
    encoder: str | None = None
    taught: bool = False


@frozen_config(ResultsError, extra="ignore")
class SuiteRecord:
    """Record of a `thalweg.bench.suite.config.Suite`; older ones have algorithms, seeds and steps in place of arms."""

    name: str
    train_level: str
    arms: TupleOf[ArmRecord] = ()
    algorithms: TupleOf[str] = ()
    seeds: TupleOf[int] = ()
    steps: int = 0
    test_levels: TupleOf[str] = ()
    baselines: TupleOf[str] = ()
    packaged: bool = False
    conditions: TupleOf[ConditionRecord] = ()
    made_by: Mapping[str, Any] = field(default_factory=dict)
    observation: str = "frames"
    rivers: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Real rivers in place of levels by name, as `recorded_reach` writes them; not those of conditions."""
    task: str = PAPER_TASK
    hard: bool = False
    forces: Mapping[str, Any] = field(default_factory=dict)
    views: Mapping[str, Any] = field(default_factory=dict)
    encoder: str = "default"
    policies: TupleOf[FlownRecord] = ()

    @model_validator(mode="after")
    def _check(self) -> "SuiteRecord":
        try:
            views_in_words(dict(self.views))
        except (TypeError, ValueError, LookupError, AttributeError) as error:
            raise ValueError(f"views must be those of a suite, got {_to_json(self.views)}") from error
        names = [condition.name for condition in self.conditions]
        for index, name in enumerate(names):
            if name in names[:index]:
                raise ValueError(f"conditions[{index}]: name must be one of its own, got {_to_json(name)} twice")
        return self


def read_suite(folder: Path) -> dict[str, Any]:
    """Return the content of `suite.json`; raises `ResultsError` for anything but the record of a suite."""
    try:
        suite = json.loads((folder / "suite.json").read_text(encoding="utf-8"))
    except (ValueError, RecursionError, OSError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise ResultsError(f"suite.json cannot be read: {why}") from error
    try:
        if not isinstance(suite, dict):
            raise ResultsError(f"it must be a mapping, got {_to_json(suite)}")
        parse_config(SuiteRecord, suite, show=_to_json)
    except ResultsError as error:
        raise ResultsError(f"suite.json is not the record of a suite: {error}") from error
    return suite


def arms_of(record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the arms of a suite's record as `Arm.as_data` does, also those of an older record without arms."""
    if "arms" in record:
        return list(record["arms"])
    common = {"seeds": record.get("seeds", []), "steps": record.get("steps", 0)}
    return [{"name": name, "algorithm": name, **common} for name in record.get("algorithms", [])]


def training_steps(arm: Mapping[str, Any]) -> int:
    """Return the training steps of each seed of an arm in a suite's record, all stages together."""
    return sum(stage["steps"] for stage in (*arm.get("before", ()), arm))


def training_in_words(record: Mapping[str, Any]) -> str:
    """Return for how many steps, all stages together, and on what the arms of a suite's record are trained: `200,000
    steps on Medium`, with all that there are."""
    arms = arms_of(record)
    steps = [f"{count:,}" for count in sorted({training_steps(arm) for arm in arms})]
    grounds = dict.fromkeys(_grounds_in_turn(record, arm) for arm in arms)
    return f"{_one_of(steps)} steps on {_one_of([*grounds], ' on')}"


def _grounds_in_turn(record: Mapping[str, Any], arm: Mapping[str, Any]) -> str:
    """Return the levels or real rivers of the stages of an arm of a suite's record, in their order."""
    grounds = [stage.get("level") or record.get("train_level", "") for stage in (*arm.get("before", ()), arm)]
    return " then ".join(name for index, name in enumerate(grounds) if not index or grounds[index - 1] != name)


def _one_of(parts: Sequence[str], before: str = "") -> str:
    """Return parts as alternatives, with words before each but the first."""
    *most, last = parts
    return f"{f',{before} '.join(most)}{',' * (len(most) > 1)} or{before} {last}" if most else last


def begins_with_teacher(arm: Mapping[str, Any]) -> bool:
    """Return whether an arm of a suite's record begins with a policy that learnt from a teacher."""
    begun = arm.get("begin_with")
    return bool(begun.get("taught")) if isinstance(begun, Mapping) else bool(begun)


def seeds_of_flown(policy: Mapping[str, Any]) -> range:
    """Return the seeds of a function or a policy that was trained before in a suite's record: places of its files."""
    return range(len(policy.get("policy", ())) or 1)


def stages_of(arm: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any], str]]:
    """Return algorithm, settings and preset of each stage of training of an arm in a suite's record, as far as it names
    them."""
    return [
        (stage["algorithm"], stage.get("settings", {}), stage.get("preset", "default"))
        for stage in (*arm.get("before", []), arm)
        if "algorithm" in stage
    ]


def observation_of(record: Mapping[str, Any], arm: Mapping[str, Any]) -> str:
    """Return what an arm of a suite's record sees, see `thalweg.train.observations.IN_WORDS`; frames if it does not
    say it."""
    return arm.get("observation") or record.get("observation", "frames")


def task_of(record: Mapping[str, Any]) -> str:
    """Return the task of a suite's record; the paper's if it does not say it."""
    return record.get("task", PAPER_TASK)


def flown_levels(record: Mapping[str, Any], condition: Mapping[str, Any]) -> list[str]:
    """Return the real rivers or levels that a condition of a suite's record is flown on, in the order of the suite."""
    return [*condition["rivers"]] or condition["levels"] or record.get("test_levels", [])


def has_forces(record: Mapping[str, Any]) -> bool:
    """Return whether wind, current or inertia move the vehicle in a suite's record."""
    forces = record.get("forces", {})
    pushes = [forces.get(name) for name in ("wind", "current_m_per_s")]
    return forces.get("dynamics") == "inertial" or any(each is not None for each in pushes)


def _grounds_named(record: Mapping[str, Any]) -> list[str]:
    """Return the names of the levels and real rivers of a suite's record that are trained on, or flown on as levels,
    also under a condition alone."""
    stages = [stage for arm in arms_of(record) for stage in (*arm.get("before", []), arm)]
    own = [level for condition in record.get("conditions", []) for level in condition["levels"]]
    named = [record.get("train_level", ""), *(stage.get("level", "") for stage in stages)]
    return [name for name in dict.fromkeys([*named, *record.get("test_levels", []), *own]) if name]


def has_banks(record: Mapping[str, Any]) -> bool:
    """Return whether a suite's record names a level with other banks than forest, or a real river that has some, also
    under a condition alone."""
    named = (record, *record.get("conditions", []))
    of_files = any(river.get("has_banks") for each in named for river in dict(each.get("rivers", {})).values())
    return of_files or any("+" in name for name in _grounds_named(record))


def _reaches_in_words(record: Mapping[str, Any]) -> str:
    """Return a sentence about the real rivers of a suite's record that stand in place of levels; empty for none."""
    told = [f"{name} is {_reach_in_words(river)}." for name, river in record.get("rivers", {}).items()]
    return " ".join(told)


def _reach_in_words(river: Mapping[str, Any]) -> str:
    """Return the file of a real river, the hash of its content, and the options that were given."""
    usual = {name: each.default for name, each in Selection.__dataclass_fields__.items()}
    options = {name: value for name, value in river.items() if name not in ("file", "content", "has_banks")}
    given = [f"{name}={value}" for name, value in options.items() if value != usual.get(name)]
    of = f", {', '.join(given)}" if given else ""
    return f"the real river of {river.get('file')} (content {river.get('content')}{of})"


def bounds_of(
    record: Mapping[str, Any], field: str, episodes: Iterable[Episode] = ()
) -> tuple[float | None, float | None]:
    """Return the bounds of a field of episodes of a suite's record for `inference.field_bounds`.

    Costs have no greatest value where each step may cost. Returns may be negative, down to minus the reward of a full
    course, where a flight may end further from the station than it began: on an open course in `Portage`, and in a task
    that is not loaded here and may be like it. On a loop no place is further than the start.
    """
    task = task_of(record)
    if field == "cost" and task != PAPER_TASK:
        return None, math.inf
    may_lose_way = task not in TASKS or TASKS[task].portage
    if field == "return_" and may_lose_way and any(row.ahead is not None for row in episodes):
        return -FULL_COURSE_REWARD, None
    return None, None


def has_papers_rules(record: Mapping[str, Any]) -> bool:
    """Return whether the task of a suite's record is the paper's, in still air and by steps."""
    return task_of(record) == PAPER_TASK and not has_forces(record)


def oracle_knows(record: Mapping[str, Any]) -> bool:
    """Return whether the oracle knows the rules of a suite's record, so that policies can be compared with its front:
    a task where safety has a price, neither in hard mode nor under forces."""
    return task_of(record) != PAPER_TASK and not record.get("hard") and not has_forces(record)


def rules_in_words(record: Mapping[str, Any]) -> str:
    """Return sentences about the rules of a suite's record, its real rivers and what was seen in training; empty for
    the paper's rules, levels and their camera."""
    views = views_in_words(dict(record.get("views", {})))
    return " ".join(filter(None, (_task_in_words(record), _reaches_in_words(record), views)))


def _task_in_words(record: Mapping[str, Any]) -> str:
    """Return a sentence about the rules of a suite's record; empty for those of the paper."""
    if has_papers_rules(record):
        return ""
    hard = ", in hard mode" if record.get("hard") else ""
    forces = record.get("forces", {})
    current = "" if forces.get("current_m_per_s") is None else "a current"
    blowing = ["wind" if forces.get("wind") else "", current, "inertia" if forces.get("dynamics") == "inertial" else ""]
    under = " and ".join(word for word in blowing if word)
    return f"The task is {task_of(record)}{hard}" + (f", under {under}." if under else ".")


def encoder_of(record: Mapping[str, Any], arm: Mapping[str, Any]) -> str:
    """Return the name of the packaged encoder whose codes an arm of a suite's record sees, if it sees any."""
    return arm.get("encoder") or record.get("encoder", "default")


def _to_json(value: Any) -> str:
    """Return a value as JSON, cut where it is long."""
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."
