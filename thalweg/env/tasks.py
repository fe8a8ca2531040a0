"""Tasks: the paper's, and those in which a limit has a price, as data on one set of rules.

A task says what is paid, what costs and when the deadline is; everything else, motion and limits included, is the same
in all. In the paper's task, `River`, only the end of an episode has a cost. In the others each step may have one, and
the greatest return breaks the limit, which can be met by returning less.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

TaskName = Literal["River", "Swimmers", "Nests", "RacingLine", "Portage"]
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
    """1: an episode that reaches its step limit was cut off by a deadline, which has no cost of its own."""
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
    """Steps for each metre of the course to fly, after which the episode is truncated; 0: the step limit of the
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
            self.fast_step_m,
            self.passing_distance_m,
            self.view_height_m,
            self.reserve_height_m,
            self.clearance_m,
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
        swimmer_spacing_m=40.0,
        deadline_steps_per_m=0.6,
        props=24,
    ),
    "Nests": Task(
        kind="nests", view_height_m=2.5, reserve_share=1 / 3, reserve_height_m=8.0, props=24,
    ),
    "RacingLine": Task(kind="clearance", clearance_m=1.5, fast_step_m=2.0, deadline_steps_per_m=0.45),
    "Portage": Task(kind="land", portage=True, deadline_steps_per_m=0.6, props=1),
}  # fmt: skip
"""Tasks by name. Their numbers are those of version `thalweg.core.versions.TASKS`.

For the deadlines: the scripted pilot needs 0.86 steps of one metre per metre of course, cutting bends and flying
askew; with fast steps it needs 0.47, and in the middle of the channel the steady pilot 0.51.
"""
