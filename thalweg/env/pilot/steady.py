"""The steady pilot, a teacher: its moves can be read off the frames that it flies through.

It cruises at one height, in the middle of the channel, and looks where it flies, so that the banks it keeps off are in
view. Where it faces a bank, it first descends until water is in view, and only then turns: from high up, a camera sees
nothing but the trees behind it, which do not tell the way. Each of its moves is judged: `worths` tries all of them,
flies on by a simple law under the exact rules, and adds up progress and what is not steady. The law pursues a point
ahead on the route. The pilot is deterministic and keeps no state.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.core.compute.threads import run_in_threads
from thalweg.env.config import EnvConfig
from thalweg.env.moves import MOVES
from thalweg.env.pilot.bank_view import sight_height
from thalweg.env.pilot.pursuit import pursue, sign_beyond
from thalweg.env.pilot.ways import Ways, missing_clearance, plan_ways, pursued_point
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.motion import UnitAction, move, wrap_angle
from thalweg.env.task.progress import (
    interpolate,
    last_segment,
    metres_left,
    track_projection,
)
from thalweg.env.task.rules import State, pose_of
from thalweg.env.task.termination import faces_backwards, first_bridge_hit, is_off_band, is_off_channel

HORIZON = 8
"""Simulated steps for each move."""
LOOKAHEAD_M = 4.0
"""Distance of the pursued point ahead."""
HEIGHT_WEIGHT = 0.3
"""Penalty in segments of progress for each metre off the height to fly at, and step."""
CLEARANCE_WEIGHT = 0.1
"""The same for each square metre of missing clearance beyond the least."""
TURN_WEIGHT = 2.0
"""The same for each radian off the pursued point."""
EFFORT = 0.05
"""The same for each branch that acts without being needed: a turn, a climb, a step aside."""
HOVER_COST = 0.5
"""The same for a first move that is none: postponing a move must not be worth as much as making it."""
BLIND_COST = 50.0
"""The same, once, for a first move other than straight down where a bank is faced and no water is in view; more than a
turn can gain. As a regret it counts as much as a fatal move, see `worst_regret` of imitations."""
CLIMBS: tuple[int, ...] = tuple(dict.fromkeys(MOVES[:, 0].tolist()))
"""The K vertical unit actions, by which `MOVES` are sorted first."""
FAILURE = -1000.0
"""Worth of a move that breaks a rule itself; each step that is flown before a rule is broken adds one."""


class SteadyPilot:
    """The steady pilot of a batch of courses; its methods take the state of any number of episodes on them."""

    def __init__(self, courses: CourseArrays, config: EnvConfig, ways: Ways | None = None) -> None:
        """`ways`: those through the courses, if they were planned before."""
        self.courses = courses
        self.limits = config.limits
        self.route = plan_ways(courses, config) if ways is None else ways

    def worths(self, state: State) -> np.ndarray:
        """Return the worths [N, M] float64 of all `MOVES`, in segments of progress less what is not steady; below
        FAILURE + HORIZON for moves after which a rule is broken."""
        found = np.empty((len(state.world), len(MOVES)))
        trials = Trials(*np.empty((3, len(state.world), len(CLIMBS))))
        fill = partial(_fill_worths, self.courses, self.limits, self.route, MOVES, state, trials, found)
        run_in_threads(len(found), fill)
        return found

    def unit_actions(self, state: State) -> np.ndarray:
        """Return the pilot's unit actions [N, 4], each -1, 0 or 1: the moves of the greatest worth."""
        return MOVES[self.worths(state).argmax(axis=1)]


class Trials(NamedTuple):
    """Memory for the flights of moves that differ by their climb alone, which are flown together."""

    z: np.ndarray
    """[N, K] float64, height of each flight in metres."""
    up: np.ndarray
    """[N, K] float64, vertical unit action of its next step."""
    worth: np.ndarray
    """[N, K] float64, of its move, so far."""


@kernel(fastmath=False, allocates=False)
def _fill_worths(courses, limits, ways, moves, state, trials, worths, first, last):
    """Fill the rows `first` to `last` of worths [N, M]."""
    apart = len(moves) // len(CLIMBS)
    for row in range(first, last):
        for index in range(apart):
            waiting = (1 << len(CLIMBS)) - 1
            while waiting != 0:
                waiting = _fly_together(row, moves[index], waiting, courses, limits, ways, state, trials)
            for climb in range(len(CLIMBS)):
                worths[row, index + climb * apart] = trials.worth[row, climb]


@kernel(fastmath=False, allocates=False)
def _fly_together(row, first_move, waiting, courses, limits, ways, state, trials):
    """Fly simulations that each start with a move and then follow the law; fill their worths in `trials`.

    The moves are `first_move` [4] with any climb. `waiting` has a bit for each climb whose move has no worth yet. The
    first of these leads, and what does not depend on heights is found once for all that move as it does. Those that
    come to move otherwise are left for another flight, and their bits are returned. Worths are to the bit as if each
    move was flown alone.
    """
    world, travel = state.world[row], state.travel[row]
    z, up, worth = trials.z[row], trials.up[row], trials.worth[row]
    pose = pose_of(state.pose, row)
    _, projection = track_projection(courses, world, state.segment[row], pose.x, pose.y)
    blind = _is_blind(pose.z, sight_height(courses, world, projection, travel, ways, pose), limits)
    _begin(first_move, blind, pose.z, waiting, z, up, worth)
    flying = waiting
    patience = 1.0 / (1.0 + state.idle[row])
    action = UnitAction(0.0, 1.0 * first_move[1], 1.0 * first_move[2], 1.0 * first_move[3])
    for step in range(HORIZON):
        after = move(pose, action, limits)
        offset, reached = track_projection(courses, world, projection.segment, after.x, after.y)
        broken, flying = _broken_together(courses, world, limits, pose, after, reached, travel, z, up, flying)
        if broken and step > 0:
            # The law turns on the spot where its move would break a rule.
            action = UnitAction(0.0, action.turn, 0.0, 0.0)
            after = move(pose, action, limits)
            offset, reached = track_projection(courses, world, projection.segment, after.x, after.y)
            broken, flying = _broken_together(courses, world, limits, pose, after, reached, travel, z, up, flying)
        gained = travel * (offset + reached.fraction - projection.fraction)
        pose, projection = after, reached
        arrived = courses.closed[world] == 0 and projection.segment == last_segment(courses, world, travel)
        for climb in range(len(CLIMBS)):
            if flying >> climb & 1:
                if broken:
                    worth[climb] = FAILURE + step
                    continue
                worth[climb] += gained
                worth[climb] -= EFFORT * (abs(up[climb]) + abs(action.turn) + abs(action.left))
                z[climb] += up[climb] * limits.vertical_step
                if arrived:
                    worth[climb] += 2.0 * (HORIZON - step)
        if broken or arrived:
            break
        left = metres_left(courses, world, projection, pose.x, pose.y)
        angle, dx, dy = pursued_point(courses, world, projection, travel, ways, left, LOOKAHEAD_M, pose)
        error = wrap_angle(angle - pose.yaw)
        sight = sight_height(courses, world, projection, travel, ways, pose)
        height = min(interpolate(courses, world, projection, ways.height), sight)
        unclear = missing_clearance(courses, world, projection, ways, left)
        _judge(height, unclear, error, patience, flying, z, worth)
        blind, flying = _climb_together(limits, height, sight, flying, z, up)
        action = UnitAction(0.0, 0.0, 0.0, 0.0) if blind else pursue(limits, pose.yaw, error, dx, dy)
    return waiting & ~flying


@kernel(fastmath=False, allocates=False)
def _begin(first_move, blind, start_z, waiting, z, up, worth):
    """Set heights, first climbs and worths, each [K], of the flights with a bit in `waiting`; blind: whether they start
    where no water is in view."""
    vertical = first_move[1] == 0 and first_move[2] == 0 and first_move[3] == 0
    for climb in range(len(CLIMBS)):
        if waiting >> climb & 1:
            z[climb], up[climb] = start_z, 1.0 * CLIMBS[climb]
            worth[climb] = -HOVER_COST if vertical and up[climb] == 0.0 else 0.0
            if blind and not (vertical and up[climb] < 0.0):
                worth[climb] -= BLIND_COST


@kernel(fastmath=False, allocates=False)
def _judge(height, unclear, error, patience, flying, z, worth):
    """Take off the worths [K] of the flights with a bit in `flying` what is not steady: metres off the height to fly
    at, square metres of missing clearance, and radians off the pursued point."""
    for climb in range(len(CLIMBS)):
        if flying >> climb & 1:
            worth[climb] -= patience * (
                CLEARANCE_WEIGHT * unclear + HEIGHT_WEIGHT * abs(height - z[climb]) + TURN_WEIGHT * abs(error)
            )


@kernel(fastmath=False, allocates=False)
def _climb_together(limits, height, sight, flying, z, up):
    """Set the vertical unit actions up [K] of the flights with a bit in `flying`, to the height to fly at; return
    whether the first of them is blind, and the bits of those for which it is the same."""
    blind = _is_blind(z[_lowest_bit(flying)], sight, limits)
    for climb in range(len(CLIMBS)):
        if flying >> climb & 1:
            if _is_blind(z[climb], sight, limits) != blind:
                flying &= ~(1 << climb)
            up[climb] = -1.0 if blind else sign_beyond(height - z[climb], 0.5 * limits.vertical_step)
    return blind, flying


@kernel(fastmath=False, allocates=False)
def _broken_together(courses, world, limits, before, after, projection, travel, z, up, flying):
    """Return whether a move of the flights with a bit in `flying`, from heights z [K] by vertical unit actions up [K],
    breaks a rule, as it does for the first of them; and the bits of those for which it is the same."""
    anywhere = is_off_channel(courses, world, projection, after.x, after.y) or faces_backwards(
        courses, world, limits, projection, after.yaw, travel
    )
    if anywhere:
        return True, flying
    broken = False
    lead = _lowest_bit(flying)
    for climb in range(lead, len(CLIMBS)):
        if flying >> climb & 1:
            reached = z[climb] + up[climb] * limits.vertical_step
            hit = first_bridge_hit(courses, world, before.x, before.y, z[climb], after.x, after.y, reached) >= 0
            found = hit or is_off_band(courses, world, limits, projection, reached)
            if climb == lead:
                broken = found
            elif found != broken:
                flying &= ~(1 << climb)
    return broken, flying


@kernel(fastmath=False, allocates=False)
def _lowest_bit(bits):
    """Return the place of the lowest bit that is set, of which there is one."""
    place = 0
    while not bits >> place & 1:
        place += 1
    return place


@kernel(fastmath=False, allocates=False)
def _is_blind(z, sight, limits):
    """Return whether a height z is more than half a vertical step above the `sight_height`, in metres."""
    return z - sight > 0.5 * limits.vertical_step
