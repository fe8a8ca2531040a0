"""Banks of other kinds laid over a valley of forest, whose own maps and random numbers stay as they are."""

from typing import NamedTuple

import numpy as np

from thalweg.world.banks import Banks
from thalweg.world.generate.banks import cover, relief, surface, zones
from thalweg.world.generate.terrain import Terrain
from thalweg.world.record import Plants, River


class Valley(NamedTuple):
    """A valley before its light."""

    terrain: Terrain
    albedo: np.ndarray
    """[GY, GX, 3] uint8, as in `World.albedo`."""
    plants: Plants


def lay(
    valley: Valley, river: River, bridge_rows: np.ndarray, banks: Banks, density: float, rng: np.random.Generator
) -> Valley:
    """Return a valley of forest with the banks of a river [S]; bridges [B, 11] and islands stay as they are.

    density: of the level's plants, see `Level.plant_density`.
    """
    measured = zones.measure(valley.terrain, river, banks)
    # Each step has numbers of its own, so that a boat's river, which has no paint, has the same rocks.
    relief_rng, paint_rng, plants_rng = rng.spawn(3)
    terrain = relief.shaped(valley.terrain, measured, bridge_rows, relief_rng)
    albedo = surface.painted(valley.albedo, terrain, measured, paint_rng) if valley.albedo.size else valley.albedo
    return Valley(terrain, albedo, cover.covered(valley.plants, terrain, measured, density, plants_rng))
