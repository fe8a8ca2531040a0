"""Initial poses of episodes: random safe poses, and the check of a pose that a user requests.

A safe pose breaks no rule that a step could break. Random poses lie anywhere along the course, at any height in the
permitted band, head either way within a limit, and keep a clearance from banks, islands and bridges.
"""

import math

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.config import DEFAULT_CONFIG, EnvConfig, Limits
from thalweg.env.task.ashore import project_anywhere
from thalweg.env.task.course_arrays import CourseArrays, pack_courses
from thalweg.env.task.motion import Pose, wrap_angle
from thalweg.env.task.progress import (
    course_direction,
    interpolate,
    last_segment,
    projection_at,
    track_projection,
)
from thalweg.env.task.termination import (
    TOLERANCE,
    first_bridge_hit,
    island_at,
    metres_past_bank,
    rule_broken,
    yaw_deviation,
)
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


@kernel(fastmath=False)
def try_start(courses, world, limits, spread, clearance, draws, out):
    """Return whether uniform numbers draws [DRAWS] give a safe start with a clearance (metres); write it to out [4]."""
    pose, near = propose_start(courses, world, limits, spread, draws)
    x, y, z = pose.x, pose.y, pose.z
    _, projection = track_projection(courses, world, near, x, y)
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
    out[0], out[1], out[2], out[3] = pose
    return True


def random_start(
    courses: CourseArrays, world: int, config: EnvConfig, limits: Limits, generator: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Return a random safe pose [4] in a world, and the initial time (s) of the water's clock."""
    pose = np.empty(4)
    spread = math.radians(config.start_heading_deg)
    for _ in range(MAX_TRIES):
        draws = generator.random(DRAWS)
        if try_start(courses, world, limits, spread, config.start_clearance_m, draws, pose):
            return pose, CLOCK_RANGE_S * float(draws[5])
    raise UnsafePoseError(f"no safe start found in world {world} among {MAX_TRIES} random poses")


def random_clock(generator: np.random.Generator) -> float:
    """Return the initial time (s) of the water's clock for an episode whose pose is given."""
    return CLOCK_RANGE_S * float(generator.random())


def sample_starts(world: World, count: int, seed: int, config: EnvConfig = DEFAULT_CONFIG) -> np.ndarray:
    """Return random safe initial poses [count, 4] in a world; pose i depends on the seed and i alone."""
    courses = pack_courses([world], config)
    generators = (np.random.default_rng([seed, index]) for index in range(count))
    starts = [random_start(courses, 0, config, config.limits, generator)[0] for generator in generators]
    return np.array(starts).reshape(count, 4)


def check_pose(courses: CourseArrays, world: int, config: EnvConfig, pose: np.ndarray) -> None:
    """Raise `UnsafePoseError` if a pose [4] breaks a limit, with the limit and the excess."""
    if not np.all(np.isfinite(pose)):
        raise UnsafePoseError(f"a pose is four finite numbers x, y, z, yaw, not {pose.tolist()}")
    x, y, z, yaw = (float(value) for value in pose)
    projection = project_anywhere(courses, world, x, y)
    bridge = first_bridge_hit(courses, world, x, y, z, x, y, z)
    if bridge >= 0:
        raise UnsafePoseError(f"the body touches the collision hull of bridge {bridge} at ({x:.2f}, {y:.2f}, {z:.2f})")
    excess = metres_past_bank(courses, world, projection)
    if excess > TOLERANCE:
        raise UnsafePoseError(
            f"({x:.2f}, {y:.2f}) is {projection.distance:.2f} m from the centre line, {excess:.2f} m beyond the bank"
        )
    island = island_at(courses, world, x, y)
    if island >= 0:
        raise UnsafePoseError(f"({x:.2f}, {y:.2f}) lies on island {island}, which is land")
    height = z - interpolate(courses, world, projection, courses.level)
    if height < config.min_height_m - TOLERANCE:
        raise UnsafePoseError(f"height {height:.4g} m is below min_height_m = {config.min_height_m:g}")
    if height > config.max_height_m + TOLERANCE:
        raise UnsafePoseError(f"height {height:.4g} m is above max_height_m = {config.max_height_m:g}")
    travel = travel_direction(courses, world, projection, yaw)
    angle = math.degrees(yaw_deviation(courses, world, projection, yaw, travel))
    if angle > config.max_yaw_deviation_deg + math.degrees(TOLERANCE):
        raise UnsafePoseError(
            f"heading {angle:.4g} degrees off the course is above"
            f" max_yaw_deviation_deg = {config.max_yaw_deviation_deg:g}"
        )
