"""Tests of clouds in kernels, against the reference renderer."""

import numpy as np
import pytest

from tests.render.plain import plane
from thalweg.core.compute.jit import kernel
from thalweg.render import Camera, Look
from thalweg.render.bake.scene_tables import build_scene
from thalweg.render.kernels.shading import clouds
from thalweg.render.kernels.table_lookup import sky_at
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.view import View
from thalweg.render.reference.materials import Materials

f32 = np.float32


@kernel
def look_up(scene, view, softness, nearest, directions, out):
    layer = clouds.cloud_layer(scene, view, softness)
    for i in range(len(directions)):
        x = directions[i, 0]
        y = directions[i, 1]
        z = directions[i, 2]
        r, g, b = sky_at(scene.sky, 0, x, y, z)
        out[i, 0, 0], out[i, 0, 1], out[i, 0, 2] = r, g, b
        if nearest:
            r, g, b = clouds.add_nearest_clouds(scene.clouds, layer, x, y, z, r, g, b)
        else:
            r, g, b = clouds.add_clouds(scene.clouds, layer, x, y, z, r, g, b)
        out[i, 1, 0], out[i, 1, 1], out[i, 1, 2] = r, g, b


def found(cover: float, nearest: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radiance [N, 3] without clouds and with them, and with those of the reference renderer."""
    rng = np.random.default_rng(5)
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = directions.astype(f32)
    world = plane()
    look = look_rows(look_values(Look(clouds=cover), 1), Camera())[0]
    out = np.empty((len(directions), 2, 3), f32)
    # The camera is not read.
    look_up(build_scene([world]), View(0, look, f32(0), f32(0)), f32(clouds.SOFTNESS), nearest, directions, out)
    expected = Materials(world, look.astype(np.float64)).clouded(directions.astype(np.float64), out[:, 0])
    return out[:, 0], out[:, 1], expected


@pytest.mark.parametrize(("nearest", "close"), [(False, 0.012), (True, 0.06)])
@pytest.mark.parametrize("cover", [0.2, 0.6, 1.0])
def test_clouds_are_those_of_the_reference(cover, nearest, close):
    clear, clouded, expected = found(cover, nearest)
    assert np.abs(clouded - clear).max() > 0.2
    assert np.quantile(np.abs(clouded - expected), 0.98) < close


def test_a_look_without_clouds_and_directions_below_the_horizon_keep_every_bit_of_the_sky():
    clear, clouded, _ = found(0.0)
    np.testing.assert_array_equal(clouded, clear)


def test_more_cover_hides_more_of_the_sky():
    hidden = [np.mean(np.abs(np.subtract(*found(cover)[:2])).max(axis=1) > 0.05) for cover in (0.1, 0.4, 0.8)]
    assert hidden[0] + 0.05 < hidden[1] < hidden[2] - 0.05
