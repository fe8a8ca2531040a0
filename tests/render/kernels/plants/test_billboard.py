"""Tests of billboards: the view of the atlas."""

import numpy as np

from thalweg.render.bake import impostors
from thalweg.render.kernels.plants.billboard import atlas_view, neighbouring_view


def test_the_atlas_view_is_the_one_nearest_to_the_direction_of_sight():
    rng = np.random.default_rng(4)
    for look, sun in rng.uniform(-np.pi, np.pi, (400, 2)):
        toward, sunward = ((np.float32(np.cos(a)), np.float32(np.sin(a))) for a in (look, sun))
        assert atlas_view(*toward, *sunward) == impostors.view_of(look, sun)


def test_two_views_are_seen_half_each_in_the_middle_between_them_and_one_in_its_own_direction():
    f32 = np.float32
    step = 2 * np.pi / impostors.VIEWS
    for view in range(impostors.VIEWS):
        seen = [(view * step, view), ((view + 0.499) * step, (view + 1) % 8), ((view - 0.499) * step, (view - 1) % 8)]
        for k, (angle, other) in enumerate(seen):
            found, share = neighbouring_view(f32(np.cos(angle)), f32(np.sin(angle)), f32(1), f32(0), np.int32(view))
            assert share == 0 if k == 0 else abs(share - 0.5) < 0.01
            assert k == 0 or found == other
