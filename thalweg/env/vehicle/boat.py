"""The boat of `EnvConfig.vehicle = "asv"`: its sizes, and how much water it wants under it.

The sizes are those of the Otter, a catamaran of Maritime Robotics: length, beam and height by the maker's data sheet
(200 x 108 x 106.5 cm, www.maritimerobotics.com/otter); Fossen's Python Vehicle Simulator has the same length and beam
(L = 2.0 m, B = 1.08 m in `vehicles/otter.py`). It draws 0.32 m, so that 0.75 m are above the water.
"""

from typing import Annotated

from pydantic import Field

from thalweg.core.config import FiniteNonNegative, FinitePositive, frozen_config


class BoatError(ValueError):
    """Impossible sizes of a boat."""


class FitError(ValueError):
    """A river that the boat does not fit, with the reach where it does not, or a river whose bed is unknown."""


@frozen_config(BoatError, numpy_scalars=True)
class Boat:
    """A box that floats on the river, with a camera on a mast at its middle, above the pose."""

    length_m: Annotated[float, Field(gt=0, le=8)] = 2.0
    """Length over all."""
    beam_m: Annotated[float, Field(gt=0, le=8)] = 1.08
    """Width over all."""
    draught_m: FinitePositive = 0.32
    """Depth of the keels below the water. Where there is less water under any part of the hull, the boat is aground."""
    keel_margin_m: FinitePositive = 0.1
    """Water that should be left below the keels; with less, each step costs, see `thalweg.env.vehicle.hull`."""
    hull_height_m: FiniteNonNegative = 0.75
    """Height of the hull above the water, which has to pass below the arches of bridges."""
    camera_height_m: FinitePositive = 1.2
    """Height of the camera above the water, and of the mast, which has to pass below them as well."""
    shallow_cost: FiniteNonNegative = 1.0
    """Cost of a step that ends where the keels all but touch the ground; it falls to 0 at the margin."""

    @property
    def words(self) -> str:
        """The sizes that decide where the boat fits, in words."""
        return f"the boat ({self.length_m:g} m by {self.beam_m:g} m, draught {self.draught_m:g} m)"
