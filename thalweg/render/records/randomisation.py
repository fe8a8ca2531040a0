"""`Randomisation`: ranges from which domain randomisation draws the fields of a `Look`.

The original environment has no domain randomisation. A policy that was trained under many looks should transfer to
others (Tobin et al. 2017, "Domain Randomization for Transferring Deep Neural Networks from Simulation to the Real
World"). The suns are baked into the worlds beforehand, a few for each, so that drawing a look is free.
"""

from dataclasses import fields
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from thalweg.core.config import PairOf, WholeNumber, frozen_config, refuse_unknown
from thalweg.render.errors import RenderError
from thalweg.render.records import appearance
from thalweg.render.records.appearance import PARAMETERS, Look

SUN_PARAMETERS = ("sun_azimuth_deg", "sun_elevation_deg")
SunAzimuthDeg = Annotated[float, Field(ge=-360, le=720)]
SunElevationDeg = Annotated[float, Field(ge=5, le=90)]
Period = Literal["episode", "environment"]
MAX_SUNS = 64
"""Each sun of each world takes 13 to 18 MB of tables for the levels."""


@frozen_config(RenderError, numpy_scalars=True)
class Randomisation:
    """Ranges of uniform distributions of the fields of a look; see `Look` for their meaning."""

    haze: PairOf[appearance.Haze] = (0.3, 6.0)
    """Factor on the density of the haze."""
    exposure_ev: PairOf[appearance.ExposureEV] = (-0.7, 0.7)
    """Exposure compensation in stops."""
    warmth: PairOf[appearance.Warmth] = (-0.6, 0.6)
    """White balance, cold to warm."""
    water_tint: PairOf[appearance.WaterTint] = (-0.8, 0.8)
    """Colour of the water, green-blue to brown."""
    turbidity: PairOf[appearance.Turbidity] = (0.4, 3.0)
    """Factor on what a metre of water absorbs and scatters."""
    ripple: PairOf[appearance.Ripple] = (0.3, 1.8)
    """Factor on the slopes of the ripples."""
    season: PairOf[appearance.Season] = (0.0, 1.0)
    """Summer to autumn."""
    plant_density: PairOf[appearance.PlantDensity] = (0.6, 1.0)
    """Share of the plants that are drawn."""
    pitch_deg: PairOf[appearance.PitchDeg] = (-5.0, 5.0)
    """Added to the camera's pitch."""
    fov_deg: PairOf[appearance.FovDeg] = (-6.0, 6.0)
    """Added to the camera's field of view."""
    noise: PairOf[appearance.Noise] = (0.0, 6.0)
    """Standard deviation of the sensor's noise in 255ths."""
    clouds: PairOf[appearance.Clouds] = (0.0, 0.8)
    """Share of the ground under cumulus."""
    sun_azimuth_deg: PairOf[SunAzimuthDeg] = (0.0, 360.0)
    """Direction towards the sun, counter-clockwise from east."""
    sun_elevation_deg: PairOf[SunElevationDeg] = (25.0, 70.0)
    """Height of the sun."""
    suns: Annotated[WholeNumber, Field(ge=0, le=MAX_SUNS)] = 4
    """Lights baked for each world, one of which is drawn; 0 keeps the world's own."""
    per: Period = "episode"
    """`episode`: drawn anew at each start; `environment`: once, when an environment is seeded."""

    @model_validator(mode="after")
    def _lower_ends_are_first(self) -> Self:
        for name in (*PARAMETERS, *SUN_PARAMETERS):
            low, high = getattr(self, name)
            if low > high:
                raise ValueError(f"{name} must have its lower end first, got {(low, high)}")
        return self

    @classmethod
    def only(cls, **ranges: Any) -> "Randomisation":
        """Return ranges for the named fields only; the others keep their defaults, and suns vary only if named."""
        refuse_unknown("range", ranges, sorted(field.name for field in fields(cls)), RenderError)
        usual = Look()
        fixed = {name: (getattr(usual, name),) * 2 for name in PARAMETERS}
        suns = {} if ranges.keys() & set(SUN_PARAMETERS) else {"suns": 0}
        return cls(**{**fixed, **suns, **ranges})

    @property
    def ends(self) -> np.ndarray:
        """Looks at the lower and the upper ends of all ranges [2, P] (see
        `thalweg.render.records.appearance.PARAMETERS`)."""
        return np.array([getattr(self, name) for name in PARAMETERS], np.float64).T

    def draw(self, generator: np.random.Generator) -> tuple[np.ndarray, int]:
        """Return a look [P] float64 and the index of a sun."""
        low, high = self.ends
        look = low + (high - low) * generator.random(len(PARAMETERS))
        return look, int(generator.integers(max(self.suns, 1)))

    def lights(self, seed: int) -> list[tuple[float, float]]:
        """Return azimuth and elevation in radians of each sun of the world with this seed.

        The suns are stratified: each lies in a different part of either range.
        """
        generator = np.random.default_rng([seed, self.suns])
        strata = (np.arange(self.suns) + generator.random((2, self.suns))) / max(self.suns, 1)
        strata[1] = generator.permuted(strata[1])
        ranges = np.array([self.sun_azimuth_deg, self.sun_elevation_deg], np.float64)
        angles = np.radians(ranges[:, :1] + (ranges[:, 1:] - ranges[:, :1]) * strata)
        return [(float(azimuth), float(elevation)) for azimuth, elevation in angles.T]
