"""Tests of billboards: the view of the atlas."""

import numpy as np

from thalweg.render.bake import impostors
from thalweg.render.kernels.billboard import atlas_view


def test_the_atlas_view_is_the_one_nearest_to_the_direction_of_sight():
    rng = np.random.default_rng(4)
    for look, sun in rng.uniform(-np.pi, np.pi, (400, 2)):
        toward, sunward = ((np.float32(np.cos(a)), np.float32(np.sin(a))) for a in (look, sun))
        assert atlas_view(*toward, *sunward) == impostors.view_of(look, sun)
