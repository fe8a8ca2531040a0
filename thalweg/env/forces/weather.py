"""Wind and current of an episode: drawn at its start, advanced with each step, and felt at a place.

All random numbers follow from the episode's key and the number of the step (`thalweg.core.compute.counter_random`), so
that the filters of the gusts are the only memory, and every device computes the same weather.
"""

import math

from thalweg.core.compute.counter_random import normal_pair, uniform
from thalweg.core.compute.jit import kernel
from thalweg.env.physics.gusts import chain_output, first_chain, step_chain, step_single
from thalweg.env.task.progress import course_direction, interpolate
from thalweg.env.task.termination import metres_past_bank

RANGES = 6
"""First of the counters of an episode's means; those below are the noise of its first gust."""


@kernel(fastmath=False, allocates=False)
def begin_weather(row, key, forces, force_state):
    """Draw the weather of a new episode of environment `row` from its key, and set its velocity to zero."""
    wind = forces.wind
    force_state.key[row] = key
    force_state.mean_wind[row, 0] = wind.speed + wind.speed_width * uniform(key, 0, RANGES)
    force_state.mean_wind[row, 1] = wind.towards + wind.towards_width * uniform(key, 0, RANGES + 1)
    force_state.mean_wind[row, 2] = wind.gust_share + wind.gust_share_width * uniform(key, 0, RANGES + 2)
    force_state.current[row] = forces.current + forces.current_width * uniform(key, 0, RANGES + 3)
    gust = force_state.gust
    gust[row, 0], _ = normal_pair(key, 0, 0)
    noise_1, noise_2 = normal_pair(key, 0, 2)
    gust[row, 1], gust[row, 2] = first_chain(noise_1, noise_2)
    noise_1, noise_2 = normal_pair(key, 0, 4)
    gust[row, 3], gust[row, 4] = first_chain(noise_1, noise_2)
    for axis in range(4):
        force_state.velocity[row, axis] = 0.0


@kernel(fastmath=False, allocates=False)
def advance_gusts(row, step, forces, force_state):
    """Advance the gusts of environment `row` to those of the step after `step`, which counts from 1."""
    way = force_state.mean_wind[row, 0] * forces.step_s
    if way == 0.0:
        return  # there are no gusts without a mean wind
    key = force_state.key[row]
    gust = force_state.gust
    h = way / forces.wind.horizontal_length
    noise_1, _ = normal_pair(key, step, 0)
    gust[row, 0] = step_single(gust[row, 0], h, noise_1)
    noise_1, noise_2 = normal_pair(key, step, 2)
    gust[row, 1], gust[row, 2] = step_chain(gust[row, 1], gust[row, 2], h, noise_1, noise_2)
    noise_1, noise_2 = normal_pair(key, step, 4)
    h = way / forces.wind.vertical_length
    gust[row, 3], gust[row, 4] = step_chain(gust[row, 3], gust[row, 4], h, noise_1, noise_2)


@kernel(fastmath=False, allocates=False)
def wind_now(row, forces, force_state):
    """Return the wind (east, north, up) in m/s that blows in the next step of environment `row`, gusts included."""
    speed = force_state.mean_wind[row, 0]
    towards = force_state.mean_wind[row, 1]
    vertical = force_state.mean_wind[row, 2] * speed
    horizontal = vertical * forces.wind.horizontal_ratio
    gust = force_state.gust
    along = speed + horizontal * gust[row, 0]
    left = horizontal * chain_output(gust[row, 1], gust[row, 2])
    cos = math.cos(towards)
    sin = math.sin(towards)
    return along * cos - left * sin, along * sin + left * cos, vertical * chain_output(gust[row, 3], gust[row, 4])


@kernel(fastmath=False, allocates=False)
def current_at(courses, world, projection, mean):
    """Return the velocity (east, north) in m/s of the water's surface at a point, by its `Projection`.

    `mean` is the mean speed in mid-channel. Across the channel the speed is a parabola that ends at the banks.
    """
    half = 0.5 * interpolate(courses, world, projection, courses.width)
    if metres_past_bank(courses, world, projection) >= 0.0:
        return 0.0, 0.0
    across = projection.distance / half
    speed = mean * interpolate(courses, world, projection, courses.flow) * (1.0 - across * across)
    course = course_direction(courses, world, projection)
    return speed * math.cos(course), speed * math.sin(course)
