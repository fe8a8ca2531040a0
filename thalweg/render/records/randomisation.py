"""How much may the look of a river change between episodes? Domain randomisation: a range for each part of a `Look`.

The original environment has none of it. A policy that meets every look in training should not mind which one it meets
later (Tobin et al. 2017, "Domain Randomization for Transferring Deep Neural Networks from Simulation to the Real
World"). The suns are baked into the worlds beforehand, a few for each, so that drawing costs nothing.
"""

from dataclasses import dataclass, fields
from numbers import Real
from typing import Any

import numpy as np

from thalweg.render.errors import RenderError
from thalweg.render.records.appearance import LIMITS, PARAMETERS, Look

Range = tuple[float, float]
SUN_LIMITS = {"sun_azimuth_deg": (-360.0, 720.0), "sun_elevation_deg": (5.0, 90.0)}
MOST_SUNS = 64
"""Each sun of each world takes about 25 MB of tables."""
PERIODS = ("episode", "environment")


@dataclass(frozen=True)
class Randomisation:
    """From where to where each part of a look is drawn, uniformly; the meaning of each is that of `Look`."""

    haze: Range = (0.3, 6.0)
    """Factor on the density of the haze."""
    exposure_ev: Range = (-0.7, 0.7)
    """Exposure compensation in stops."""
    warmth: Range = (-0.6, 0.6)
    """White balance, cold to warm."""
    water_tint: Range = (-0.8, 0.8)
    """Colour of the water, green-blue to brown."""
    turbidity: Range = (0.4, 3.0)
    """Factor on what a metre of water absorbs and scatters."""
    ripple: Range = (0.3, 1.8)
    """Factor on the slopes of the ripples."""
    season: Range = (0.0, 1.0)
    """Summer to autumn."""
    plant_density: Range = (0.6, 1.0)
    """Share of the plants that are drawn."""
    pitch_deg: Range = (-5.0, 5.0)
    """Added to the camera's pitch."""
    fov_deg: Range = (-6.0, 6.0)
    """Added to the camera's field of view."""
    noise: Range = (0.0, 6.0)
    """Standard deviation of the sensor's noise in 255ths."""
    sun_azimuth_deg: Range = (0.0, 360.0)
    """Direction towards the sun, counter-clockwise from east."""
    sun_elevation_deg: Range = (25.0, 70.0)
    """Height of the sun."""
    suns: int = 4
    """Lights baked for each world, one of which is drawn; 0 keeps the world's own."""
    per: str = "episode"
    """`episode`: drawn anew at each start; `environment`: once, when an environment is seeded."""

    def __post_init__(self) -> None:
        for name, (low, high) in (LIMITS | SUN_LIMITS).items():
            check_range(name, getattr(self, name), low, high)
        if isinstance(self.suns, bool) or self.suns != int(self.suns) or not 0 <= self.suns <= MOST_SUNS:
            raise RenderError(f"suns = {self.suns!r}: choose a whole number from 0 to {MOST_SUNS}")
        if self.per not in PERIODS:
            raise RenderError(f"per = {self.per!r}: choose {' or '.join(PERIODS)}")

    @classmethod
    def only(cls, **ranges: Any) -> "Randomisation":
        """Ranges for the named parts only; the others keep the default look, and no sun is baked unless it is named."""
        known = {field.name for field in fields(cls)}
        unknown = sorted(set(ranges) - known)
        if unknown:
            raise RenderError(f"nothing called {', '.join(unknown)} can vary; known: {', '.join(sorted(known))}")
        usual = Look()
        fixed = {name: (getattr(usual, name),) * 2 for name in PARAMETERS}
        suns = {} if ranges.keys() & SUN_LIMITS.keys() else {"suns": 0}
        return cls(**{**fixed, **suns, **ranges})

    @property
    def ends(self) -> np.ndarray:
        """The looks at the lower and the upper ends of all ranges [2, P] (see
        `thalweg.render.records.appearance.PARAMETERS`)."""
        return np.array([getattr(self, name) for name in PARAMETERS], np.float64).T

    def draw(self, generator: np.random.Generator) -> tuple[np.ndarray, int]:
        """A look [P] float64, and which sun."""
        low, high = self.ends
        look = low + (high - low) * generator.random(len(PARAMETERS))
        return look, int(generator.integers(max(self.suns, 1)))

    def lights(self, seed: int) -> list[tuple[float, float]]:
        """Azimuth and elevation in radians of each sun of the world with this seed.

        Each lies in a part of its own of either range, so that few suns cover it.
        """
        generator = np.random.default_rng([seed, self.suns])
        places = (np.arange(self.suns) + generator.random((2, self.suns))) / max(self.suns, 1)
        places[1] = generator.permuted(places[1])
        ranges = np.array([self.sun_azimuth_deg, self.sun_elevation_deg], np.float64)
        angles = np.radians(ranges[:, :1] + (ranges[:, 1:] - ranges[:, :1]) * places)
        return [(float(azimuth), float(elevation)) for azimuth, elevation in angles.T]


def check_range(name: str, value: Any, low: float, high: float) -> None:
    """Raise `RenderError` unless the value is a pair of numbers in order, within low..high."""
    try:
        first, last = value
    except (TypeError, ValueError):
        raise RenderError(f"{name} = {value!r}: a range is two numbers, such as ({low:g}, {high:g})") from None
    if not all(isinstance(end, Real) and not isinstance(end, bool) for end in (first, last)):
        raise RenderError(f"{name} = {value!r}: a range is two numbers, such as ({low:g}, {high:g})")
    if first > last:
        raise RenderError(f"{name} = {value!r} is upside down: write the lower end first")
    if not (low <= first and last <= high):
        raise RenderError(f"{name} = {value!r} leaves what is physical: from {low:g} to {high:g}")
