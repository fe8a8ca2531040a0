"""`Wind`: the mean wind and its gusts, and the low-altitude formulas of the Dryden model.

Sources: MIL-F-8785C, "Flying Qualities of Piloted Airplanes", 1980, sections 3.7.2 (spectra) and 3.7.3.1 to 3.7.3.4
(low altitude); the same in MIL-HDBK-1797, 1997, which halves the lengths of the lateral and vertical gusts and writes
the spectra accordingly. Three things are simpler here than there. Height enters once, as `Wind.height_m`, in place of
the height of the moment, because a UAV over a river stays within 15 m of the water; so the mean wind has no shear. The
air passes the vehicle at the mean speed of the wind, in place of the vehicle's airspeed, which is of the same size. And
the lateral axes are those of the wind, not of the vehicle.
"""

from typing import Annotated

from pydantic import Field

from thalweg.core.config import FiniteNonNegative, FiniteNumber, Fraction, PairOf, frozen_config
from thalweg.env.errors import ConfigError
from thalweg.env.physics.ranges import FromNumber, InOrder

FOOT_M = 0.3048
LARGE_GUST = 3.0
"""Standard deviations of a gust that a vehicle must hold against: one that 0.3 % of all moments exceed."""


@frozen_config(ConfigError, numpy_scalars=True)
class Wind:
    """Mean wind and gusts of each episode. A field that is a pair is a range, from which each episode draws uniformly
    by its seed; one number is given for a range of nothing else."""

    speed_m_per_s: Annotated[PairOf[FiniteNonNegative], FromNumber, InOrder] = (1.0, 4.0)
    """Mean speed, at 6 m above the water."""
    towards_deg: Annotated[PairOf[FiniteNumber], FromNumber, InOrder] = (0.0, 360.0)
    """Direction towards which the wind blows, counter-clockwise from east, as yaw is."""
    gust_share: Annotated[PairOf[FiniteNonNegative], FromNumber, InOrder] = (0.1, 0.1)
    """Standard deviation of the vertical gusts as a share of the mean speed; 0.1 is that of MIL-F-8785C. The horizontal
    gusts follow from it."""
    height_m: Annotated[float, Field(ge=10 * FOOT_M, le=1000 * FOOT_M)] = 20 * FOOT_M
    """Height above the ground for which the gusts are those of the model."""
    drift_share: Fraction = 0.15
    """Share of the wind's velocity with which it pushes a vehicle that moves by steps, whose controller holds
    imperfectly. With inertia the share is `Inertia.wind_share`, and this one is not used."""


def horizontal_ratio(height_m: float) -> float:
    """Return the standard deviation of the horizontal gusts over that of the vertical ones (MIL-F-8785C, figure 11)."""
    return (0.177 + 0.000823 * height_m / FOOT_M) ** -0.4


def horizontal_length(height_m: float) -> float:
    """Return the length in metres of the horizontal gusts (MIL-F-8785C, figure 10); that of the vertical ones is the
    height."""
    return height_m * (0.177 + 0.000823 * height_m / FOOT_M) ** -1.2


def strongest_push(wind: Wind, share: float) -> float:
    """Return the speed in m/s with which the strongest wind pushes a vehicle that moves with this share of it, in a
    gust of `LARGE_GUST`."""
    return share * wind.speed_m_per_s[1] * _with_gusts(wind)


def strongest_held(wind: Wind, share: float, speed_m_per_s: float) -> float:
    """Return the greatest mean speed in m/s whose gusts a vehicle with this speed still holds against."""
    return speed_m_per_s / (share * _with_gusts(wind))


def _with_gusts(wind: Wind) -> float:
    """Return the speed of the wind in a gust of `LARGE_GUST` as a multiple of its mean speed."""
    return 1.0 + LARGE_GUST * wind.gust_share[1] * horizontal_ratio(wind.height_m)
