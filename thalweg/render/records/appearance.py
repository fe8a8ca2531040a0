"""`Look`: haze, exposure, water, season, lens, sensor and clouds, which can change without rebuilding the world.

The defaults are the conditions that the levels are tuned for. `look_rows` converts looks to the rows that the kernels
read. The sun is not part of a look, because it is baked into a world (`World.relit` changes it).
"""

from collections.abc import Sequence
from dataclasses import astuple, fields
from typing import Annotated

import numpy as np
from pydantic import Field

from thalweg.core.config import bounds, frozen_config
from thalweg.render.errors import RenderError
from thalweg.render.records.camera import Camera

# Columns of a row that the kernels read.
(
    HAZE_PER_M, GAIN_R, GAIN_G, GAIN_B, ABSORB_R, ABSORB_G, ABSORB_B, SCATTER_R, SCATTER_G, SCATTER_B, RIPPLE, SEASON,
    DENSITY, PITCH, HALF_W, HALF_H, NOISE, CLOUDS, DRIFT_A_X, DRIFT_A_Y, DRIFT_B_X, DRIFT_B_Y,
) = range(22)  # fmt: skip
LOOK_COLUMNS = 22

HAZE_1_PER_M = 1 / 1500.0
"""Share of the light that a metre of air takes away on the default day."""
ABSORB = (1.25, 1.35, 1.55)
"""Share of red, green, blue lost per metre of water (as exponents) on the default day."""
SCATTER = (0.0170, 0.0153, 0.0128)
"""Radiance that deep water sends up in full sun."""
RIPPLE_1 = 0.42
"""Factor on the slopes of each ripple layer, whose mean square in the tile is fixed."""
DRIFT_A_M_PER_S = (0.35, 0.12)
DRIFT_B_M_PER_S = (-0.14, 0.23)
"""Velocities with which the tiles of the two layers of ripples are read, in the axes of each layer; the ripples move
the other way."""
GREEN_ABSORB, BROWN_ABSORB = (1.35, 0.62, 0.72), (0.70, 1.15, 1.90)
"""Factors on ABSORB of a river as clear as glacier melt, and of one as brown as a bog's; between is geometric."""
GREEN_SCATTER, BROWN_SCATTER = (0.45, 1.55, 1.60), (2.60, 1.65, 0.55)
WARM, COLD = (1.16, 1.0, 0.80), (0.86, 1.0, 1.22)
"""Gains of red, green, blue at the ends of the white balance."""

# Physical limits of each field of `Look`, and of each range of `Randomisation`.
Haze = Annotated[float, Field(ge=0, le=40)]
ExposureEV = Annotated[float, Field(ge=-4, le=4)]
Warmth = Annotated[float, Field(ge=-1, le=1)]
WaterTint = Annotated[float, Field(ge=-1, le=1)]
Turbidity = Annotated[float, Field(ge=0, le=20)]
Ripple = Annotated[float, Field(ge=0, le=4)]
Season = Annotated[float, Field(ge=0, le=1)]
PlantDensity = Annotated[float, Field(ge=0, le=1)]
PitchDeg = Annotated[float, Field(ge=-60, le=60)]
FovDeg = Annotated[float, Field(ge=-50, le=60)]
Noise = Annotated[float, Field(ge=0, le=64)]
Clouds = Annotated[float, Field(ge=0, le=1)]


@frozen_config(RenderError, numpy_scalars=True)
class Look:
    """Appearance of a world in a frame."""

    haze: Haze = 1.0
    """Factor on the density of the haze; at 1 a kilometre lets half of the light through."""
    exposure_ev: ExposureEV = 0.0
    """Exposure compensation in stops, on top of the automatic exposure."""
    warmth: Warmth = 0.0
    """White balance from -1 (cold, blue) to 1 (warm, orange)."""
    water_tint: WaterTint = 0.0
    """Colour of the water from -1 (green-blue, as of melting snow) to 1 (brown, as of a bog)."""
    turbidity: Turbidity = 1.0
    """Factor on how much light a metre of water absorbs and scatters; at 0 the water is as clear as air."""
    ripple: Ripple = 1.0
    """Factor on the slopes of the ripples; at 0 the water is a mirror."""
    season: Season = 0.0
    """From 0 (summer) to 1 (autumn): leaves turn yellow, needles and reeds a little."""
    plant_density: PlantDensity = 1.0
    """Share of the plants that are drawn. Their shadows stay."""
    pitch_deg: PitchDeg = 0.0
    """Added to the camera's pitch; positive looks further down."""
    fov_deg: FovDeg = 0.0
    """Added to the camera's vertical field of view."""
    noise: Noise = 0.0
    """Standard deviation of the sensor's noise in 255ths of white, in each channel and pixel anew."""
    clouds: Clouds = 0.2
    """About the share of the ground under cumulus; at 0 the sky is clear, at 1 overcast. Clouds cast no shadows."""


PARAMETERS = tuple(field.name for field in fields(Look))
"""The columns of looks as arrays [N, P]."""
LIMITS = {name: bounds(Look, name) for name in PARAMETERS}
"""The minimum and the maximum of each field of `Look`."""


def look_values(look: "Look | Sequence[Look] | np.ndarray | None", count: int) -> np.ndarray:
    """Return looks for `count` frames as [N, P] float64; one look applies to all frames, None is the default look.

    Raises `RenderError` for another number of looks, or a value outside `LIMITS`.
    """
    if look is None:
        look = Look()
    if isinstance(look, Look):
        return np.tile(np.array(astuple(look), np.float64), (count, 1))
    if not isinstance(look, np.ndarray):
        look = np.array([astuple(each) for each in look], np.float64).reshape(-1, len(PARAMETERS))
    values = np.asarray(look, np.float64)
    if values.shape != (count, len(PARAMETERS)):
        raise RenderError(f"looks have shape {list(values.shape)}; expected {[count, len(PARAMETERS)]}")
    check_values(values)
    return values


def check_values(values: np.ndarray) -> None:
    """Raise `RenderError` that names the first value of looks [N, P] outside `LIMITS`."""
    for column, (name, (low, high)) in enumerate(LIMITS.items()):
        wrong = ~((values[:, column] >= low) & (values[:, column] <= high))
        if wrong.any():
            value = values[np.argmax(wrong), column]
            raise RenderError(f"{name} must be a number from {low:g} to {high:g}, got {value:g}")


def look_rows(values: np.ndarray, camera: Camera) -> np.ndarray:
    """Return the rows [N, LOOK_COLUMNS] float32 that the kernels read, for looks [N, P] and a camera.

    Raises `RenderError` if camera and look together exceed the limits of a camera.
    """
    value = dict(zip(PARAMETERS, values.T, strict=True))
    pitch, fov = camera.pitch_deg + value["pitch_deg"], camera.fov_deg + value["fov_deg"]
    for name, angle, low, high in (("pitch_deg", pitch, -89.0, 89.0), ("fov_deg", fov, 5.0, 150.0)):
        if len(angle) and not (low <= angle.min() and angle.max() <= high):
            wrong = angle[np.argmax((angle < low) | (angle > high))]
            raise RenderError(f"camera and look together make {name} = {wrong:g}; it must be from {low:g} to {high:g}")
    rows = np.empty((len(values), LOOK_COLUMNS), np.float32)
    rows[:, HAZE_PER_M] = value["haze"] * HAZE_1_PER_M
    warm = between(value["warmth"], COLD, WARM)
    rows[:, GAIN_R : GAIN_B + 1] = 2.0 ** value["exposure_ev"][:, None] * warm
    turbid = value["turbidity"][:, None]
    rows[:, ABSORB_R : ABSORB_B + 1] = ABSORB * turbid * between(value["water_tint"], GREEN_ABSORB, BROWN_ABSORB)
    # Water that absorbs as much as it scatters keeps its radiance where it is deep; more sediment makes it paler.
    rows[:, SCATTER_R : SCATTER_B + 1] = (
        SCATTER * np.sqrt(turbid) * between(value["water_tint"], GREEN_SCATTER, BROWN_SCATTER)
    )
    rows[:, RIPPLE] = RIPPLE_1 * value["ripple"]
    rows[:, SEASON] = value["season"]
    rows[:, DENSITY] = value["plant_density"]
    rows[:, PITCH] = np.radians(pitch)
    rows[:, HALF_H] = np.tan(np.radians(fov) / 2)
    rows[:, HALF_W] = np.tan(np.radians(fov) / 2) * camera.width_px / camera.height_px
    rows[:, NOISE] = value["noise"]
    rows[:, CLOUDS] = value["clouds"]
    rows[:, DRIFT_A_X : DRIFT_B_Y + 1] = *DRIFT_A_M_PER_S, *DRIFT_B_M_PER_S
    return rows


def between(share: np.ndarray, low: Sequence[float], high: Sequence[float]) -> np.ndarray:
    """Return factors [N, 3] for shares [N]: those of `low` at -1, one at 0, those of `high` at 1, geometric between."""
    ends = np.where(share[:, None] < 0, np.log(low), np.log(high))
    return np.exp(np.abs(share)[:, None] * ends)
