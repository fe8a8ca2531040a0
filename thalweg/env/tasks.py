"""Tasks: the paper's, and those in which a limit has a price, as data on one set of rules.

A task says what is paid, what costs and when the deadline is; everything else, motion and limits included, is the same
in all. In the paper's task, `River`, only the end of an episode has a cost. In the others each step may have one, and
the greatest return breaks the limit, which can be met by returning less.
"""

import math
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Literal, NamedTuple

from thalweg.core.plugins.lookup import find, names
from thalweg.core.plugins.record import Plugin, PluginError, check_record

TaskName = Literal["River", "Swimmers", "Nests", "RacingLine", "Portage"]
PAPER_TASK: TaskName = "River"
ENDING_KINDS = ("tight", "loose")
"""Kinds of cost that the end of an episode may have, in every task."""


class TaskRules(NamedTuple):
    """Numbers of a task as the kernels take them; 0 switches the rule off that a number belongs to."""

    fast_step: float
    """Metres forward by the third option of the longitudinal branch."""
    passing_distance: float
    """Metres to a swimmer or kayak within which a fast step costs 1."""
    view_height: float
    """Metres above the water up to which the view of nests is full; the reward falls with the height above it."""
    reserve_height: float
    """Metres above the water below which a step in a reserve costs 1."""
    clearance: float
    """Metres to the nearest bank, island or stone within which a step costs up to 1."""
    portage: int
    """1: land may be crossed, a step over it costs 1, and the reward is progress towards a station."""
    deadline: int
    """1: the step limit is a deadline, at which the episode terminates without a cost of its own; 0: it truncates."""
    hard: int
    """1: the first cost of the task ends the episode."""


@dataclass(frozen=True)
class Task:
    """What is particular to a task."""

    kind: str = ""
    """Name of its own kind of cost in `info["costs"]`; empty if only endings have a cost."""
    fast_step_m: float = 0.0
    """Distance of a fast step, the third option of the longitudinal branch; 0: the option is backward, see
    `EnvConfig.allow_backward`."""
    passing_distance_m: float = 0.0
    """A fast step that ends within this distance of a swimmer or kayak costs 1; measured over the water, whatever the
    height."""
    swimmer_spacing_m: float = 0.0
    """Metres of course for each swimmer or kayak."""
    view_height_m: float = 0.0
    """Height above the water up to which a new segment is seen in full; from a height h above it the reward is
    (view_height_m / h)² of the full one, as a nest fills that share of the pixels."""
    reserve_share: float = 0.0
    """Share of the course that lies in reserves."""
    reserve_period_m: float = 60.0
    """Metres of course for each reserve, about."""
    reserve_height_m: float = 0.0
    """A step in a reserve below this height above the water costs 1."""
    clearance_m: float = 0.0
    """A step that ends with the clearance c costs 1 - c / clearance_m, and nothing from clearance_m on."""
    portage: bool = False
    """Whether the reward is progress towards a gauge station, and land may be crossed, at a cost of 1 a step."""
    deadline_steps_per_m: float = 0.0
    """Steps for each metre of the course to fly, after which the episode terminates; 0: after the step limit of the
    paper."""
    props: int = 0
    """Greatest number of objects that are drawn at a time."""

    @property
    def cost_kinds(self) -> tuple[str, ...]:
        """Names of the K kinds of cost in `info["costs"]`."""
        return (*ENDING_KINDS, self.kind) if self.kind else ENDING_KINDS

    def rules(self, *, hard: bool) -> TaskRules:
        """Return the numbers of this task as the kernels take them."""
        return TaskRules(
            float(self.fast_step_m),
            float(self.passing_distance_m),
            float(self.view_height_m),
            float(self.reserve_height_m),
            float(self.clearance_m),
            int(self.portage),
            int(bool(self.kind)),
            int(hard),
        )


TASKS: dict[str, Task] = {
    "River": Task(),
    "Swimmers": Task(
        kind="swimmers",
        fast_step_m=2.0,
        passing_distance_m=10.0,
        swimmer_spacing_m=20.0,
        deadline_steps_per_m=0.6,
        props=24,
    ),
    "Nests": Task(
        kind="nests", view_height_m=2.5, reserve_share=1 / 3, reserve_height_m=8.0, props=24,
    ),
    "RacingLine": Task(kind="clearance", clearance_m=2.5, fast_step_m=2.0, deadline_steps_per_m=0.45),
    "Portage": Task(kind="land", portage=True, deadline_steps_per_m=0.6, props=1),
}  # fmt: skip
"""Tasks by name. Their numbers are those of version `thalweg.core.versions.TASKS`.

For the deadlines: the scripted pilot needs 0.86 steps of one metre per metre of course, cutting bends and flying
askew; with fast steps it needs 0.47, and in the middle of the channel the steady pilot 0.51.
"""

GROUP = "thalweg.tasks"
"""Group of the entry points of tasks."""
FREE = ("kind", "deadline_steps_per_m")
"""Fields of a task that may be set or not, whatever its rules are."""


@dataclass(frozen=True)
class TaskPlugin:
    """A task from outside the package: other numbers for the rules of a task of the package.

    Raises `PluginError` for a name that is taken, a version below 1, a number of the task of another type or out of
    range, and a task whose rules are those of no other.
    """

    name: str
    task: Task
    """Such as `dataclasses.replace(TASKS["Nests"], reserve_height_m=6.0)`."""
    about: str
    """Description in one line."""
    version: int = 0
    """Version of its numbers, 1 or more; to be raised when they change."""
    plugin_group: ClassVar[str] = GROUP

    def __post_init__(self) -> None:
        check_record(GROUP, self.name, self.version, TASKS)
        if not isinstance(self.task, Task):
            raise PluginError(f"the task of {self.name} is {self.task!r}; it must be a thalweg.env.tasks.Task")
        _check_values(self.name, self.task)
        if not self.task.kind.isidentifier() or self.task.kind in ENDING_KINDS:
            raise PluginError(f"kind of {self.name} is {self.task.kind!r}; name the cost of its steps, such as 'nests'")
        if not _family(self.task):
            raise PluginError(
                f"{self.name} has the rules of no task; change numbers of one of {', '.join(list(TASKS)[1:])}:"
                ' replace(TASKS["Nests"], reserve_height_m=6.0)'
            )


_RANGES = {"reserve_share": (0.0, 1.0, "from 0 to 1"), "reserve_period_m": (math.ulp(0.0), math.inf, "above 0")}
"""Least and greatest value of numbers of a task, and the range in words; others are 0 or more."""


def _check_values(name: str, task: Task) -> None:
    """Raise `PluginError` for a value of a task of another type than its default, not finite, or out of range."""
    for field in fields(task):
        value, kind = getattr(task, field.name), type(field.default)
        if kind is float:
            least, most, words = _RANGES.get(field.name, (0.0, math.inf, "of 0 or more"))
            number = isinstance(value, int | float) and not isinstance(value, bool)
            right, needed = number and math.isfinite(value) and least <= value <= most, f"a finite number {words}"
        elif kind is int:
            right, needed = type(value) is int and value >= 0, "a whole number of 0 or more"
        else:
            right, needed = type(value) is kind, "true or false" if kind is bool else "a text"
        if not right:
            raise PluginError(f"{field.name} of {name} is {value!r}; it must be {needed}")


_IN_USE: dict[str, Task] = {}
"""Tasks of plug-ins that a config names, which are looked up at every step."""


def task_plugin(name: str) -> Plugin | None:
    """Return the plug-in of the task with exactly that name; None for one of the package, or none at all."""
    plugin = None if name in TASKS else find(GROUP, name, TASKS)
    return plugin if plugin is not None and plugin.name == name else None


def task_names() -> list[str]:
    """Return the names of all tasks, those of plug-ins last."""
    return [*TASKS, *(name for name in names(GROUP) if name not in TASKS)]


def check_task(name: str) -> None:
    """Raise `ValueError`, which lists the tasks, for the name of none; `PluginError` for a plug-in that is broken."""
    if name in TASKS:
        return
    plugin = task_plugin(name)
    if plugin is None:
        raise ValueError(f"task must be one of {', '.join(map(repr, task_names()))}, got {name!r}")
    _IN_USE[name] = plugin.record.task


def task_named(name: str) -> Task:
    """Return the task with a name, from the package or a plug-in; raises `ValueError` for the name of none."""
    if name in TASKS:
        return TASKS[name]
    if name not in _IN_USE:
        check_task(name)
    return _IN_USE[name]


def rules_like(name: str) -> str:
    """Return the name of the task of the package whose rules a task has; its own name if it is of the package."""
    return name if name in TASKS else _family(task_named(name))


def _family(task: Task) -> str:
    """Return the name of the task of the package with the same rules, whatever their numbers; empty without any."""
    on: dict[str, Any] = {name: _rules_on(other) for name, other in TASKS.items() if other.kind}
    return next((name for name, rules in on.items() if rules == _rules_on(task)), "")


def _rules_on(task: Task) -> set[str]:
    """Return the fields that switch rules of a task on."""
    usual = {"reserve_period_m"}  # it has a default that is no switch
    chosen = (field.name for field in fields(task) if field.name not in (*FREE, *usual))
    return {name for name in chosen if getattr(task, name)}
