"""Arrays and numbers of wind, current and inertia, as kernels take them."""

import math
from typing import NamedTuple

import numpy as np

from thalweg.env.config import EnvConfig
from thalweg.env.physics.inertia import Inertia
from thalweg.env.physics.wind import Wind, horizontal_length, horizontal_ratio

GUST_STATES = 5
"""States of the filters of gusts: one of the longitudinal, two of the lateral, two of the vertical gust."""


class ForceState(NamedTuple):
    """What wind, current and inertia add to the state of N episodes (`thalweg.env.task.rules.State`)."""

    key: np.ndarray
    """[N] int64, of the random numbers of the episode, which follow from it and the number of the step alone."""
    mean_wind: np.ndarray
    """[N, 3] float64: speed (m/s), direction towards which it blows (radians), vertical gusts over speed."""
    gust: np.ndarray
    """[N, GUST_STATES] float64, of filters of unit variance; those of the gust that blows in the next step."""
    current: np.ndarray
    """[N] float64, m/s: mean speed of the current in mid-channel."""
    velocity: np.ndarray
    """[N, 4] float64: east, north, up (m/s) and yaw rate (radians/s); of inertial dynamics only. It is relative to the
    water where a current carries the vehicle, which adds to its way alone, and over ground otherwise."""


class WindNumbers(NamedTuple):
    """Numbers of a `Wind` as the kernels take them: ranges as the lower end and the width."""

    speed: float
    speed_width: float
    towards: float
    """Radians."""
    towards_width: float
    gust_share: float
    gust_share_width: float
    horizontal_ratio: float
    """Standard deviation of the horizontal gusts over that of the vertical ones."""
    horizontal_length: float
    """Metres."""
    vertical_length: float
    drift_share: float


class InertiaNumbers(NamedTuple):
    """Numbers of an `Inertia` as the kernels take them: SI units and radians."""

    forward: float
    lateral: float
    vertical: float
    yaw_rate: float
    time_constant: float
    vertical_time_constant: float
    yaw_time_constant: float
    acceleration: float
    vertical_acceleration: float
    drag: float


class Forces(NamedTuple):
    """Numbers of an `EnvConfig` about wind, current and inertia as the kernels take them, flags as 0 or 1."""

    step_s: float
    inertial: int
    afloat: int
    """1: the current carries the vehicle, and no wind lifts it."""
    current: float
    """Lower end (m/s) of the range of the mean current, and its width."""
    current_width: float
    wind: WindNumbers
    inertia: InertiaNumbers


def empty_forces(count: int) -> ForceState:
    """Return the force state of N episodes that have not started."""
    rows = lambda columns: np.zeros((count, columns))  # noqa: E731
    return ForceState(np.zeros(count, np.int64), rows(3), rows(GUST_STATES), np.zeros(count), rows(4))


def force_numbers(config: EnvConfig) -> Forces:
    """Return the numbers of a config as the kernels take them; without a wind, those of one of speed 0."""
    low, high = (0.0, 0.0) if config.current_m_per_s is None else config.current_m_per_s
    wind = Wind(speed_m_per_s=(0.0, 0.0)) if config.wind is None else config.wind
    inertial, afloat = int(config.dynamics == "inertial"), int(config.carried_by_current or config.vehicle == "asv")
    return Forces(
        float(config.step_s), inertial, afloat, low, high - low, _wind_numbers(wind), _inertia_numbers(config.inertia)
    )


def _wind_numbers(wind: Wind) -> WindNumbers:
    (slow, fast), (right, left), (even, gusty) = wind.speed_m_per_s, wind.towards_deg, wind.gust_share
    return WindNumbers(
        slow,
        fast - slow,
        math.radians(right),
        math.radians(left - right),
        even,
        gusty - even,
        horizontal_ratio(wind.height_m),
        horizontal_length(wind.height_m),
        wind.height_m,
        wind.drift_share,
    )


def _inertia_numbers(inertia: Inertia) -> InertiaNumbers:
    return InertiaNumbers(
        inertia.forward_m_per_s,
        inertia.lateral_m_per_s,
        inertia.vertical_m_per_s,
        math.radians(inertia.yaw_deg_per_s),
        inertia.time_constant_s,
        inertia.vertical_time_constant_s,
        inertia.yaw_time_constant_s,
        inertia.acceleration_m_per_s2,
        inertia.vertical_acceleration_m_per_s2,
        inertia.drag_per_s,
    )
