"""Initial poses of episodes: random safe poses, and the check of a pose that a user requests.

A safe pose breaks no rule that a step could break. Random poses lie anywhere along the course, at any height in the
permitted band, head either way within a limit, and keep a clearance from banks, islands and bridges. A boat starts
where it can turn on the spot to the direction of travel and go on from there, with the margin of water below its keels.
"""

import math

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.config import DEFAULT_CONFIG, EnvConfig, Limits
from thalweg.env.task.ashore import project_anywhere
from thalweg.env.task.course_arrays import CourseArrays, pack_courses
from thalweg.env.task.ideal_eye import arc_length
from thalweg.env.task.motion import Pose, wrap_angle
from thalweg.env.task.priced.station import REACHED_M, station_of, way_to
from thalweg.env.task.progress import (
    Projection,
    course_direction,
    interpolate,
    last_segment,
    metres_left,
    projection_at,
    sample_rows,
    track_projection,
)
from thalweg.env.task.rules import afloat, begin_task
from thalweg.env.task.termination import (
    TOLERANCE,
    first_bridge_hit,
    island_at,
    metres_past_bank,
    rule_broken,
    yaw_deviation,
)
from thalweg.env.vehicle.hull import CLEAR, SOLID, first_hit, least_depth, touches_solid
from thalweg.env.vehicle.lanes import lies_in_lane
from thalweg.world.record import World

DRAWS = 6
"""Uniform numbers for one random start: arc length, lateral offset, height, heading, direction, clock of the water."""
MAX_TRIES = 10_000
CLOCK_RANGE_S = 600.0
"""The clock of the water starts anywhere in this range, so that no policy sees the same ripples in every episode."""


class UnsafePoseError(ValueError):
    """An initial pose that breaks a limit, with the limit and the excess; or a world without any safe start."""


@kernel(fastmath=False, allocates=False)
def travel_direction(courses, world, projection, yaw):
    """Return the direction along the course, 1 or -1, that is closer to a heading."""
    return 1 if yaw_deviation(courses, world, projection, yaw, 1) <= 0.5 * math.pi else -1


@kernel(fastmath=False, allocates=False)
def begin_at_pose(row, courses, limits, state, scene):
    """Let an episode begin in environment `row` at the pose of its state: set the rest of the state but for the time;
    scene: seed of what moves on the river."""
    world = state.world[row]
    projection = project_anywhere(courses, world, state.pose[row, 0], state.pose[row, 1])
    state.segment[row] = projection.segment
    state.travel[row] = travel_direction(courses, world, projection, state.pose[row, 3])
    for segment in range(state.visited.shape[1]):
        state.visited[row, segment] = 0
    state.visited_count[row] = 0
    state.steps[row] = 0
    state.idle[row] = 0
    begin_task(row, courses, limits, state, projection, scene)


@kernel(fastmath=False, allocates=False)
def propose_start(courses, world, limits, spread, draws):
    """Return (`Pose`, segment) of a random start from uniform numbers draws [DRAWS], before any check; `spread` in
    radians."""
    centre = projection_at(courses, world, draws[0] * courses.length[world])
    course = course_direction(courses, world, centre)
    side = (draws[1] - 0.5) * interpolate(courses, world, centre, courses.width)
    x = interpolate(courses, world, centre, courses.position[:, 0]) - side * math.sin(course)
    y = interpolate(courses, world, centre, courses.position[:, 1]) + side * math.cos(course)
    z = (
        interpolate(courses, world, centre, courses.level)
        + limits.min_height
        + draws[2] * (limits.max_height - limits.min_height)
    )
    way = 0.0 if draws[4] < 0.5 else math.pi
    return Pose(x, y, z, wrap_angle(course + way + (2.0 * draws[3] - 1.0) * spread)), centre.segment


@kernel(fastmath=False, allocates=False)
def is_at_station(courses, world, projection, travel):
    """Return whether an episode that starts at a `Projection` has reached its station; travel: 1 or -1."""
    station = station_of(courses, world, projection, travel)
    way, _ = way_to(courses, world, arc_length(courses, world, projection), station)
    return way <= REACHED_M


@kernel(fastmath=False)
def try_start(courses, world, limits, spread, clearance, draws, out):
    """Return whether uniform numbers draws [DRAWS] give a safe start with a clearance (metres); write it to out [4]."""
    pose, near = propose_start(courses, world, limits, spread, draws)
    _, projection = track_projection(courses, world, near, pose.x, pose.y)
    pose = afloat(courses, world, limits, projection, pose)
    x, y, z = pose.x, pose.y, pose.z
    travel = travel_direction(courses, world, projection, pose.yaw)
    if metres_past_bank(courses, world, projection) > -clearance:
        return False
    if rule_broken(courses, world, limits, pose, pose, projection, travel) >= 0:
        return False
    # The projection may lie in another segment than the drawn one, where the course has another direction.
    if yaw_deviation(courses, world, projection, pose.yaw, travel) > spread + TOLERANCE:
        return False
    # On an open course the last segment is the goal.
    if courses.closed[world] == 0 and projection.segment == last_segment(courses, world, travel):
        return False
    if limits.task.portage != 0 and is_at_station(courses, world, projection, travel):
        return False
    if limits.is_boat != 0:
        free = boat_can_set_off(courses, world, limits, projection, travel, pose, clearance)
    else:
        free = _is_clear_of_objects(courses, world, x, y, z, clearance)
    if free:
        out[0], out[1], out[2], out[3] = pose
    return free


@kernel(fastmath=False, allocates=False)
def _is_clear_of_objects(courses, world, x, y, z, clearance):
    """Return whether a point keeps a clearance (metres) from islands and bridges."""
    if first_bridge_hit(courses, world, x, y, z - clearance, x, y, z + clearance) >= 0:
        return False
    for side in range(8):
        dx = clearance * math.cos(0.25 * math.pi * side)
        dy = clearance * math.sin(0.25 * math.pi * side)
        if (
            island_at(courses, world, x + dx, y + dy) >= 0
            or first_bridge_hit(courses, world, x, y, z, x + dx, y + dy, z) >= 0
        ):
            return False
    return True


@kernel(fastmath=False, allocates=False)
def boat_can_set_off(courses, world, limits, projection, travel, pose, clearance):
    """Return whether a boat at a `Pose` can turn on the spot to the direction of travel, keeping the margin of water
    below its keels and a clearance (metres) from what is solid, and whether a way through the river leads on from
    there."""
    course = course_direction(courses, world, projection) + (0.0 if travel > 0 else math.pi)
    error = wrap_angle(course - pose.yaw)
    turns = int(math.ceil(abs(error) / limits.yaw_step))  # noqa: RUF046 - a float on GPUs
    for turn in range(turns + 1):
        yaw = pose.yaw + (error * turn / turns if turns > 0 else 0.0)
        if touches_solid(courses, world, pose.x, pose.y, yaw, limits, clearance):
            return False
        if least_depth(courses, world, pose.x, pose.y, yaw, limits) < limits.draught + limits.keel_margin:
            return False
    a, b = sample_rows(courses, world, projection.segment)
    left = metres_left(courses, world, projection, pose.x, pose.y)
    way = 0 if travel > 0 else 1
    return lies_in_lane(courses, a, way, left) and lies_in_lane(courses, b, way, left)


def random_start(
    courses: CourseArrays, world: int, config: EnvConfig, limits: Limits, generator: np.random.Generator, river: str
) -> tuple[np.ndarray, float]:
    """Return a random safe pose [4] in a world, and the initial time (s) of the water's clock.

    Raises `UnsafePoseError`, with the name of the `river` and the settings of starts, if none is found.
    """
    pose = np.empty(4)
    spread = math.radians(config.start_heading_deg)
    for _ in range(MAX_TRIES):
        draws = generator.random(DRAWS)
        if try_start(courses, world, limits, spread, config.start_clearance_m, draws, pose):
            return pose, CLOCK_RANGE_S * float(draws[5])
    heights = f", at heights of {config.min_height_m:g} to {config.max_height_m:g} m (min_height_m, max_height_m)"
    raise UnsafePoseError(
        f"no safe start found in {river} among {MAX_TRIES:,} random poses with start_clearance_m ="
        f" {config.start_clearance_m:g} and start_heading_deg = {config.start_heading_deg:g}"
        f"{heights if config.vehicle == 'uav' else ''}: set a smaller clearance, or choose a wider river"
    )


def random_clock(generator: np.random.Generator) -> float:
    """Return the initial time (s) of the water's clock for an episode whose pose is given."""
    return CLOCK_RANGE_S * float(generator.random())


def sample_starts(world: World, count: int, seed: int, config: EnvConfig = DEFAULT_CONFIG) -> np.ndarray:
    """Return random safe initial poses [count, 4] in a world; pose i depends on the seed and i alone."""
    courses = pack_courses([world], config)
    generators = (np.random.default_rng([seed, index]) for index in range(count))
    river = world.label
    starts = [random_start(courses, 0, config, config.limits, generator, river)[0] for generator in generators]
    return np.array(starts).reshape(count, 4)


def check_pose(courses: CourseArrays, world: int, config: EnvConfig, pose: np.ndarray) -> None:
    """Raise `UnsafePoseError` if a pose [4] breaks a limit, with the limit and the excess."""
    if not np.all(np.isfinite(pose)):
        raise UnsafePoseError(f"a pose is four finite numbers x, y, z, yaw, not {pose.tolist()}")
    x, y, z, yaw = (float(value) for value in pose)
    projection = project_anywhere(courses, world, x, y)
    if config.vehicle == "asv":
        _check_hull(courses, world, config, Pose(x, y, z, yaw), projection)
    else:
        _check_volume(courses, world, config, Pose(x, y, z, yaw), projection)
    travel = travel_direction(courses, world, projection, yaw)
    angle = math.degrees(yaw_deviation(courses, world, projection, yaw, travel))
    if angle > config.max_yaw_deviation_deg + math.degrees(TOLERANCE):
        raise UnsafePoseError(
            f"heading {angle:.4g} degrees off the course is above"
            f" max_yaw_deviation_deg = {config.max_yaw_deviation_deg:g}"
        )
    _check_goal(courses, world, config, Pose(x, y, z, yaw), projection)


def _check_goal(courses: CourseArrays, world: int, config: EnvConfig, pose: Pose, projection: Projection) -> None:
    """Raise `UnsafePoseError` if a pose lies at the goal."""
    travel = travel_direction(courses, world, projection, pose.yaw)
    if config.task_record.portage:
        at_goal, goal = is_at_station(courses, world, projection, travel), f"within {REACHED_M:g} m of the station"
    else:
        at_goal = not courses.closed[world] and projection.segment == last_segment(courses, world, travel)
        goal = "in the last segment of the course in the direction of travel"
    if at_goal:
        raise UnsafePoseError(f"({pose.x:.2f}, {pose.y:.2f}) lies {goal}, which is the goal")


def _check_volume(courses: CourseArrays, world: int, config: EnvConfig, pose: Pose, projection: Projection) -> None:
    """Raise `UnsafePoseError` if a pose is outside the volume in which a vehicle may fly."""
    x, y, z, _ = pose
    bridge = first_bridge_hit(courses, world, x, y, z, x, y, z)
    if bridge >= 0:
        raise UnsafePoseError(f"the body touches the collision hull of bridge {bridge} at ({x:.2f}, {y:.2f}, {z:.2f})")
    _check_bank(courses, world, x, y, projection)
    island = island_at(courses, world, x, y)
    if island >= 0:
        raise UnsafePoseError(f"({x:.2f}, {y:.2f}) lies on island {island}, which is land")
    height = z - interpolate(courses, world, projection, courses.level)
    if height < config.min_height_m - TOLERANCE:
        raise UnsafePoseError(f"height {height:.4g} m is below min_height_m = {config.min_height_m:g}")
    if height > config.max_height_m + TOLERANCE:
        raise UnsafePoseError(f"height {height:.4g} m is above max_height_m = {config.max_height_m:g}")


def _check_bank(courses: CourseArrays, world: int, x: float, y: float, projection: Projection) -> None:
    """Raise `UnsafePoseError` if a point is beyond the banks."""
    excess = metres_past_bank(courses, world, projection)
    if excess > TOLERANCE:
        raise UnsafePoseError(
            f"({x:.2f}, {y:.2f}) is {projection.distance:.2f} m from the centre line, {excess:.2f} m beyond the bank"
        )


def _check_hull(courses: CourseArrays, world: int, config: EnvConfig, pose: Pose, projection: Projection) -> None:
    """Raise `UnsafePoseError` if a boat's hull does not float freely at a pose; its height has no meaning."""
    x, y, _, yaw = pose
    _check_bank(courses, world, x, y, projection)
    hit = first_hit(courses, world, config.limits, pose, pose)
    if hit == SOLID:
        raise UnsafePoseError(f"the hull touches a rock or a bridge at ({x:.2f}, {y:.2f})")
    if hit != CLEAR:
        depth = least_depth(courses, world, x, y, yaw, config.limits)
        raise UnsafePoseError(
            f"the boat is aground at ({x:.2f}, {y:.2f}): {depth:.2f} m of water under the hull, draught"
            f" {config.boat.draught_m:g} m"
        )
