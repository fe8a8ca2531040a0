"""Where may an episode begin? Random safe poses, and the check of a pose that somebody asks for.

A safe pose breaks no rule that a step could break. Random ones lie anywhere along the course, at any height in the
band, heading either way within a limit, and keep a clearance from banks, islands and bridges.
"""

import math

import numpy as np

from thalweg.core.jit import kernel
from thalweg.env.config import DEFAULT_CONFIG, EnvConfig, Limits
from thalweg.env.task.course_arrays import Courses, pack
from thalweg.env.task.motion import wrapped
from thalweg.env.task.progress import between, direction, followed, nearest_on, sample_rows
from thalweg.env.task.termination import EDGE, beyond_bank, deviation, hazard, hits_bridge, on_island
from thalweg.world.record import World

DRAWS = 6
"""Uniform numbers that one random start uses: arc, side, height, heading, way, and the clock of the water."""
TRIES = 10_000
CLOCK_S = 600.0
"""The water's clock begins anywhere in this time, so that no policy sees the same ripples in every episode."""


class UnsafePoseError(ValueError):
    """A start pose that breaks a limit; says which and by how much. Also: a world without any safe start."""


@kernel(fastmath=False)
def located(courses, world, x, y):
    """(segment, fraction, distance) of the projection of any point, sought along the whole course.

    Where arms lie side by side the one counts within whose banks the point lies deepest.
    """
    deepest = 1.0e300
    segment = 0
    for candidate in range(courses.segments[world]):
        squared, fraction = nearest_on(courses, world, candidate, x, y)
        depth = beyond_bank(courses, world, candidate, fraction, math.sqrt(squared))
        if depth < deepest:
            deepest = depth
            segment = candidate
    _, segment, fraction, distance = followed(courses, world, segment, x, y)
    return segment, fraction, distance


@kernel(fastmath=False)
def heading_way(courses, world, segment, fraction, yaw):
    """1 or -1: the direction along the course that is nearer to a heading."""
    return 1 if deviation(courses, world, segment, fraction, yaw, 1) <= 0.5 * math.pi else -1


@kernel(fastmath=False)
def candidate(courses, world, limits, spread, draws):
    """(x, y, z, yaw, segment) of a random start from uniform numbers draws [DRAWS], before any check; `spread` in
    radians."""
    target = draws[0] * courses.length[world]
    low = 0
    high = courses.segments[world] - 1
    first = courses.first_sample[world]
    while low < high:
        middle = (low + high + 1) // 2
        if courses.arc[first + middle] <= target:
            low = middle
        else:
            high = middle - 1
    a, b = sample_rows(courses, world, low)
    end = courses.length[world] if b < a else courses.arc[b]
    fraction = min(max((target - courses.arc[a]) / (end - courses.arc[a]), 0.0), 1.0)
    course = direction(courses, world, low, fraction)
    side = (draws[1] - 0.5) * between(courses, world, low, fraction, courses.width)
    x = between(courses, world, low, fraction, courses.position[:, 0]) - side * math.sin(course)
    y = between(courses, world, low, fraction, courses.position[:, 1]) + side * math.cos(course)
    z = (
        between(courses, world, low, fraction, courses.level)
        + limits.min_height
        + draws[2] * (limits.max_height - limits.min_height)
    )
    way = 0.0 if draws[4] < 0.5 else math.pi
    return x, y, z, wrapped(course + way + (2.0 * draws[3] - 1.0) * spread), low


@kernel(fastmath=False)
def drawn_start(courses, world, limits, spread, clearance, draws, pose):
    """Whether uniform numbers draws [DRAWS] give a safe start with clearance (metres), which is written to pose [4]."""
    x, y, z, yaw, near = candidate(courses, world, limits, spread, draws)
    _, segment, fraction, distance = followed(courses, world, near, x, y)
    travel = heading_way(courses, world, segment, fraction, yaw)
    if beyond_bank(courses, world, segment, fraction, distance) > -clearance:
        return False
    if hazard(courses, world, limits, x, y, z, x, y, z, yaw, segment, fraction, distance, travel) >= 0:
        return False
    if deviation(courses, world, segment, fraction, yaw, travel) > spread + EDGE:
        return False
    if courses.closed[world] == 0 and segment == (courses.segments[world] - 1 if travel > 0 else 0):
        return False
    if hits_bridge(courses, world, x, y, z - clearance, x, y, z + clearance) >= 0:
        return False
    for side in range(8):
        dx = clearance * math.cos(0.25 * math.pi * side)
        dy = clearance * math.sin(0.25 * math.pi * side)
        if (
            on_island(courses, world, x + dx, y + dy) >= 0
            or hits_bridge(courses, world, x, y, z, x + dx, y + dy, z) >= 0
        ):
            return False
    pose[0], pose[1], pose[2], pose[3] = x, y, z, yaw
    return True


def random_start(
    courses: Courses, world: int, config: EnvConfig, limits: Limits, generator: np.random.Generator
) -> tuple[np.ndarray, float]:
    """A random safe pose [4] in a world, and the time (s) at which the water's clock begins."""
    pose = np.empty(4)
    spread = math.radians(config.start_heading_deg)
    for _ in range(TRIES):
        draws = generator.random(DRAWS)
        if drawn_start(courses, world, limits, spread, config.start_clearance_m, draws, pose):
            return pose, CLOCK_S * float(draws[5])
    raise UnsafePoseError(f"no safe start found in world {world} among {TRIES} random poses")


def random_clock(generator: np.random.Generator) -> float:
    """The time (s) at which the water's clock begins where the pose is given."""
    return CLOCK_S * float(generator.random())


def sample_starts(world: World, count: int, seed: int, config: EnvConfig = DEFAULT_CONFIG) -> np.ndarray:
    """Random safe start poses [count, 4] in a world; start i depends on the seed and i alone."""
    courses = pack([world], config)
    generators = (np.random.default_rng([seed, index]) for index in range(count))
    starts = [random_start(courses, 0, config, config.limits, generator)[0] for generator in generators]
    return np.array(starts).reshape(count, 4)


def check_pose(courses: Courses, world: int, config: EnvConfig, pose: np.ndarray) -> None:
    """Raises `UnsafePoseError` when a pose [4] breaks a limit, naming the limit and by how much."""
    if not np.all(np.isfinite(pose)):
        raise UnsafePoseError(f"a pose is four finite numbers x, y, z, yaw, not {pose.tolist()}")
    x, y, z, yaw = (float(value) for value in pose)
    segment, fraction, distance = located(courses, world, x, y)
    bridge = hits_bridge(courses, world, x, y, z, x, y, z)
    if bridge >= 0:
        raise UnsafePoseError(f"the body touches the collision hull of bridge {bridge} at ({x:.2f}, {y:.2f}, {z:.2f})")
    beyond = beyond_bank(courses, world, segment, fraction, distance)
    if beyond > EDGE:
        raise UnsafePoseError(
            f"({x:.2f}, {y:.2f}) is {distance:.2f} m from the centre line, {beyond:.2f} m beyond the bank"
        )
    island = on_island(courses, world, x, y)
    if island >= 0:
        raise UnsafePoseError(f"({x:.2f}, {y:.2f}) lies on island {island}, which is land")
    height = z - between(courses, world, segment, fraction, courses.level)
    if height < config.min_height_m - EDGE:
        raise UnsafePoseError(f"height {height:.4g} m is below min_height_m = {config.min_height_m:g}")
    if height > config.max_height_m + EDGE:
        raise UnsafePoseError(f"height {height:.4g} m is above max_height_m = {config.max_height_m:g}")
    travel = heading_way(courses, world, segment, fraction, yaw)
    angle = math.degrees(deviation(courses, world, segment, fraction, yaw, travel))
    if angle > config.max_yaw_deviation_deg + math.degrees(EDGE):
        raise UnsafePoseError(
            f"heading {angle:.4g} degrees off the course is above"
            f" max_yaw_deviation_deg = {config.max_yaw_deviation_deg:g}"
        )
