"""Tests of the formulas of water."""

import math

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.shading import water_optics

f32 = np.float32


@kernel
def glitter(sun, leans, spread, sunlit, out):
    for i in range(len(leans)):
        # Straight down on the water: a facet mirrors the sun where its slope is half way to it.
        out[i] = water_optics.glints(sun, f32(0), f32(0), f32(-1), leans[i], f32(0), spread, sunlit)


def test_glitter_is_brightest_where_the_slope_mirrors_the_sun_and_never_subnormal():
    sun = f32(math.sin(0.5)), f32(0.0), f32(math.cos(0.5))
    leans = np.linspace(-3.0, 1.0, 4001).astype(f32)
    out = np.empty(len(leans), f32)
    for spread, sunlit in ((0.0008, 1.0), (0.0008, 1e-3), (0.02, 0.3)):
        glitter(sun, leans, f32(spread), f32(sunlit), out)
        # What filtering took away is the spread of both axes together.
        width = 0.5 * (spread + water_optics.ROUGHNESS) + water_optics.SUN_WIDTH
        # tan(0.25) tilts the surface's normal half way to the sun.
        off = leans.astype(float) + math.tan(0.25)
        exact = water_optics.GLITTER * sunlit * np.exp(-(off**2) / (2 * width)) / (2 * math.pi * width)
        np.testing.assert_allclose(out, np.minimum(exact, water_optics.GLITTER_MOST), rtol=2e-3, atol=1e-12)
        assert abs(leans[np.argmax(exact)] + math.tan(0.25)) < 2e-3
        # The products of a frame's shading, times tints and transmittances, stay normal too.
        assert (out * f32(1e-6) >= np.finfo(f32).tiny).all()
