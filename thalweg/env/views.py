"""What do the cameras of a step see, and by which light? Views of the renderer, and the worlds under their suns."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from thalweg.render.records.randomisation import Randomisation
from thalweg.world.record import World


class View(NamedTuple):
    """What M cameras see."""

    pose: np.ndarray
    """[M, 4] float64."""
    world: np.ndarray
    """[M] int64."""
    time_s: np.ndarray
    """[M] float64."""
    look: np.ndarray
    """[M, P] float64, see `thalweg.render.records.appearance`."""
    sun: np.ndarray
    """[M] int64, which of the world's lights."""


def lit(worlds: Sequence[World], randomisation: Randomisation | None) -> list[World]:
    """The worlds, each under every sun of the randomisation, one world's after another's."""
    if randomisation is None or not randomisation.suns:
        return list(worlds)
    return [world.relit(*light) for world in worlds for light in randomisation.lights(world.seed)]
