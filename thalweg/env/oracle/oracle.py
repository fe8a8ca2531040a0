"""`Oracle`: flies a task with the map and all that moves in mind, at a price of cost in units of return.

At price 0 it returns as much as it can, whatever that costs; at a high price it avoids all cost that it can. Between
them lies the front that policies are compared with. It is a planner of good, not of proven, quality: tests compare it
with exact dynamic programming where that is possible.
"""

import itertools

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.core.compute.threads import run_in_threads
from thalweg.env.config import ConfigError, EnvConfig
from thalweg.env.oracle.ahead import MARGIN_M, arc_at, metres_ahead
from thalweg.env.oracle.climbs import HEIGHT_STEP_M, fill_climbs
from thalweg.env.oracle.lanes import POINTS, fill_along, fill_lanes
from thalweg.env.oracle.overland import LandGrid
from thalweg.env.oracle.plan import Plan, empty_plan
from thalweg.env.oracle.search import CRUISE_M, choose
from thalweg.env.oracle.speeds import fill_near, fill_speeds
from thalweg.env.pilot.heights import plan_heights
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.ideal_eye import arc_length
from thalweg.env.task.priced.station import REACHED_M, greatest_way
from thalweg.env.task.progress import track_projection
from thalweg.env.task.reward_cost import FULL_COURSE_REWARD
from thalweg.env.task.rules import State, empty_outcome, empty_state

PACE = float(np.hypot(1.0, 0.5))
"""Metres of a step forward and sideways."""


class Oracle:
    """Flights in one river, planned when they start."""

    def __init__(self, courses: CourseArrays, config: EnvConfig, price: float) -> None:
        """`courses`: those of one river. Raises `ConfigError` for the paper's task, whose costs have no price, for more
        rivers, for a price that is negative or not finite, and in tasks with a fast step for steps forward that its
        tables of metres do not have."""
        if config.task == "River":
            raise ConfigError("the task River has no price: a violation ends the episode; use the scripted pilot")
        if len(courses.segments) != 1:
            raise ConfigError(f"an oracle flies in one river, not in {len(courses.segments)}")
        if not (np.isfinite(price) and price >= 0):
            raise ConfigError(f"price must be a finite number of 0 or more, not {price}")
        _check_fast_step(config)
        self.courses, self.config, self.limits, self.price = courses, config, config.limits, float(price)
        self.moves = _moves(config)
        length = float(courses.length[0])
        way = greatest_way(courses, 0) if config.task_record.portage else length
        self._step_worth = FULL_COURSE_REWARD / way
        self._metres = int(np.ceil(length + MARGIN_M)) if courses.closed[0] else int(np.ceil(length)) + 1
        self._grid = LandGrid(courses, 0) if config.task_record.portage else None

    def plan(self, state: State) -> tuple[Plan, np.ndarray]:
        """Return the plan of flights that begin in a state of N episodes, and how many metres ahead [N] each is: 0."""
        flights = len(state.world)
        plan = empty_plan(flights, self.price, self._step_worth)
        plan.travel[:] = state.travel
        _fill_start(self.courses, state, plan.start_arc)
        segment = float(self.courses.length[0] / self.courses.segments[0])
        # A loop is completed as its last segment is entered; an open course as well.
        for row in range(flights):
            left = self.courses.length[0] - plan.start_arc[row] if plan.travel[row] > 0 else plan.start_arc[row]
            plan.completed_m[row] = (self.courses.length[0] if self.courses.closed[0] else left) - segment
        if self._grid is not None:
            return self._over_land(plan, state), np.zeros(flights)
        return self._along_course(plan, state), np.zeros(flights)

    def actions(self, plan: Plan, state: State, ahead: np.ndarray, active: np.ndarray) -> np.ndarray:
        """Return unit actions [N, 4] of the episodes where active [N] is True, hovering elsewhere; ahead [N] becomes
        the metres ahead of now."""
        chosen = np.zeros((len(active), 4))
        rows = np.flatnonzero(active)

        def work(first: int, last: int) -> None:
            trial, fallback = (empty_state(np.zeros(1, np.int64), self.courses) for _ in range(2))
            outcome, action = empty_outcome(1, 3), np.zeros((1, 4))
            scratch = trial, fallback, outcome, action
            _choose_all(self.courses, self.limits, plan, self.moves, state, rows[first:last], ahead, *scratch, chosen)

        run_in_threads(len(rows), work, unequal=True)
        return chosen

    def _along_course(self, plan: Plan, state: State) -> Plan:
        """Return the plan with lanes, and with speeds or heights where the task needs them."""
        count, (metres, task) = len(plan.travel), (self._metres, self.config.task_record)
        heights, lowest = plan_heights(self.courses, self.config, CRUISE_M)
        height = np.zeros((count, metres), np.float32)
        least = np.zeros((count, metres), np.float32)
        _fill_along(self.courses, plan, heights, height)
        _fill_along(self.courses, plan, lowest, least)
        plan = plan._replace(
            reach=np.zeros((count, metres), np.float32),
            place=np.zeros((count, metres, POINTS, 2)),
            lane=np.zeros((count, metres, POINTS), np.int8),
            lane_steps=np.zeros((count, metres, POINTS), np.float32),
            height=height,
            lowest=least,
        )
        clearance = task.clearance_m
        # Clearance costs by the step, and against the deadline a fast step is worth its metres.
        price_steps = self.price / (self._step_worth * max(task.fast_step_m, 1.0)) if clearance else -1.0
        for row in range(count):
            fill_lanes(self.courses, 0, price_steps, max(clearance, 1.0), PACE, plan, row)
        if task.view_height_m:
            size = count, metres, int((self.limits.max_height - self.limits.min_height) / HEIGHT_STEP_M) + 1
            plan = plan._replace(climb_value=np.zeros(size, np.float32), climb=np.zeros(size, np.int8))
            for row in range(count):
                fill_climbs(self.courses, 0, self.limits, self._step_worth, plan, row)
        if task.fast_step_m:
            size = count, int(self.courses.max_steps[0]) + 1, metres
            plan = plan._replace(speed_value=np.zeros(size, np.float32), speed=np.zeros(size, np.int8))
            near, along = np.zeros(size[1:], np.uint8), np.zeros(metres)
            for row in range(count):
                place = int(state.scene[row]), task.passing_distance_m, plan.start_arc[row], int(plan.travel[row])
                fill_near(self.courses, 0, *place, near)
                if clearance:
                    fill_along(self.courses, 0, clearance, plan, row, along)
                worth = int(task.fast_step_m), self._step_worth, self.price
                fill_speeds(near, along, plan.completed_m[row], *worth, plan.speed_value[row], plan.speed[row])
        return plan

    def _over_land(self, plan: Plan, state: State) -> Plan:
        """Return the plan with ways over water and land."""
        assert self._grid is not None
        price_steps = min(self.price / self._step_worth, 1.0e4)
        ways = [
            self._grid.ways_to(station, 0.5 * REACHED_M, price_steps, PACE, start, int(travel))
            for station, start, travel in zip(state.station, plan.start_arc, plan.travel, strict=True)
        ]
        steps, onward = (np.stack(arrays) for arrays in zip(*ways, strict=True))
        plan.grid_origin[:] = self._grid.origin
        return plan._replace(grid_steps=steps, grid_next=onward)


def _check_fast_step(config: EnvConfig) -> None:
    """Raise `ConfigError` in a task with a fast step unless that has whole metres and the plain step has one: tables
    have a place for each metre."""
    fast = config.task_record.fast_step_m
    if not fast:
        return
    if not float(fast).is_integer():
        raise ConfigError(f"an oracle plans whole metres: fast_step_m of {config.task} must be whole, not {fast:g}")
    if config.forward_step_m != 1.0:
        raise ConfigError(
            f"an oracle plans whole metres: forward_step_m must be 1 in the task {config.task}, not"
            f" {config.forward_step_m:g}"
        )


def _moves(config: EnvConfig) -> np.ndarray:
    """Return the first moves [M, 4] that are tried, of equal ones the first: unit actions up, turn left, forward, left.

    Heights are a law's where only bridges matter to them. Else a climb comes first: one that can be put off seems as
    good in the next step, and would be put off again.
    """
    climbs = (1.0, 0.0, -1.0) if config.task_record.view_height_m else (0.0,)
    forwards = (1.0, 0.0, -1.0) if config.task_record.fast_step_m else (1.0, 0.0)
    return np.array(list(itertools.product(climbs, (0.0, 1.0, -1.0), forwards, (0.0, 1.0, -1.0))))


@kernel(fastmath=False, allocates=False)
def _fill_start(courses, state, start_arc):
    """Fill start_arc [N]: metres along the course of the episodes' places."""
    for row in range(len(start_arc)):
        _, projection = track_projection(courses, 0, state.segment[row], state.pose[row, 0], state.pose[row, 1])
        start_arc[row] = arc_length(courses, 0, projection)


@kernel(fastmath=False, allocates=False)
def _fill_along(courses, plan, values, table):
    """Fill table [N, G] with values [S] at the samples of the only course, interpolated at each metre ahead."""
    spacing = courses.length[0] / courses.segments[0]
    for row in range(table.shape[0]):
        for ahead in range(table.shape[1]):
            share = arc_at(courses, 0, plan.start_arc[row], plan.travel[row], float(ahead)) / spacing
            segment = min(int(share), courses.segments[0] - 1)
            following = (segment + 1) % len(values)
            table[row, ahead] = values[segment] + (share - segment) * (values[following] - values[segment])


@kernel(fastmath=False, allocates=False)
def _choose_all(courses, limits, plan, moves, state, rows, ahead, trial, fallback, outcome, action, chosen):
    """Choose moves for some rows, and bring `ahead` up to now."""
    for index in range(len(rows)):
        row = rows[index]
        _, projection = track_projection(courses, 0, state.segment[row], state.pose[row, 0], state.pose[row, 1])
        ahead[row] = metres_ahead(courses, 0, plan.start_arc[row], plan.travel[row], projection, ahead[row])
        choose(courses, limits, plan, moves, state, row, ahead, trial, fallback, outcome, action, chosen)
