"""Tests of rays and solids: the kernels against small steps along each ray, and against many rays a pixel."""

import numpy as np
import pytest

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.props import models
from thalweg.render.kernels.props.solids import SolidRay, meet_solid
from thalweg.render.reference.props import PlacedPart, meet, outside

f32 = np.float32


@kernel
def meet_all(shape, taper, origin, rays, right, up, found):
    """Fill found [K, 5] with the `SolidHit` of rays [K, 3] from an origin [3] that differ by right and up a pixel."""
    for k in range(len(rays)):
        found[k] = meet_solid(
            shape, taper,
            SolidRay(
                origin[0], origin[1], origin[2], rays[k, 0], rays[k, 1], rays[k, 2],
                right[0], right[1], right[2], up[0], up[1], up[2],
            ),
        )  # fmt: skip


def hits(shape: int, taper: float, origin: np.ndarray, rays: np.ndarray, pixel: float) -> np.ndarray:
    """The `SolidHit`s [K, 5] of rays whose pixels are `pixel` wide at distance one, across y and z."""
    found = np.empty((len(rays), 5), f32)
    right, up = np.array([0, pixel, 0], f32), np.array([0, 0, pixel], f32)
    meet_all(f32(shape), f32(taper), origin.astype(f32), rays.astype(f32), right, up, found)
    return found


def solid(shape: int, taper: float) -> PlacedPart:
    model = np.zeros(models.MODEL_COLUMNS)
    model[models.SHAPE], model[models.TAPER] = shape, taper
    return PlacedPart(model, np.eye(3), np.zeros(3), 0, 0.0, 1.0, False)


def grid(side: int, half: float) -> np.ndarray:
    """Rays [side², 3] ahead along x, over a square of the image plane."""
    at = (np.arange(side) + 0.5) / side * 2 * half - half
    y, z = np.meshgrid(at, at, indexing="ij")
    return np.stack([np.ones_like(y), y, z], axis=-1).reshape(-1, 3)


SOLIDS = [(models.SPHERE, 1.0), (models.CUBE, 1.0), (models.CONE, 1.0), (models.CONE, 0.2), (models.CONE, 0.0)]
ORIGIN = np.array([-6.0, 0.4, 1.3])


def tilted(rays: np.ndarray) -> np.ndarray:
    """The rays, aimed at the solid from `ORIGIN`."""
    return rays + np.array([0, *(-ORIGIN[1:] / 6.0)])


@pytest.mark.parametrize(("shape", "taper"), SOLIDS)
def test_a_ray_enters_a_solid_where_small_steps_find_it(shape: int, taper: float):
    rays = tilted(grid(40, 0.3))
    found, wanted = hits(shape, taper, ORIGIN, rays, 1e-6), meet(solid(shape, taper), ORIGIN, rays)
    # A step may pass an edge of less than its length.
    same = (found[:, 0] > 0.5) == np.isfinite(wanted)
    assert same.mean() > 0.99 and 0.1 < np.isfinite(wanted).mean() < 0.9
    both = (found[:, 0] > 0.5) & np.isfinite(wanted)
    np.testing.assert_allclose(found[both, 1], wanted[both], atol=2e-3)


@pytest.mark.parametrize(("shape", "taper"), SOLIDS)
def test_a_normal_points_to_where_the_surface_rises(shape: int, taper: float):
    rays = tilted(grid(24, 0.3))
    found = hits(shape, taper, ORIGIN, rays, 1e-6)
    entered = found[:, 0] > 0.5
    # Out of the solid, towards the side from which the ray comes.
    towards = (found[entered, 2:] * rays[entered]).sum(axis=1)
    assert (towards < 1e-4).all()
    at = ORIGIN + rays[entered] * found[entered, 1:2]
    lengths = np.linalg.norm(found[entered, 2:], axis=1)
    outward = found[entered, 2:] / lengths[:, None]
    model = solid(shape, taper).model
    rises = outside(model, at + 1e-3 * outward) - outside(model, at - 1e-3 * outward)
    # Beside an edge the two points may lie on different faces.
    assert (rises > 0).mean() > 0.97


@pytest.mark.parametrize(("shape", "taper"), SOLIDS)
def test_the_share_of_a_pixel_is_that_of_many_rays(shape: int, taper: float):
    side, fine = 16, 24
    pixel = 0.6 / side
    found = hits(shape, taper, ORIGIN, tilted(grid(side, 0.3)), pixel)[:, 0].reshape(side, side)
    inside = hits(shape, taper, ORIGIN, tilted(grid(side * fine, 0.3)), 1e-6)[:, 0] > 0.5
    wanted = inside.reshape(side, fine, side, fine).mean(axis=(1, 3))
    assert ((wanted > 0.05) & (wanted < 0.95)).sum() > 20
    apart = np.abs(found - wanted)
    # A sphere's outline is smooth; where two edges meet, only one of them is known.
    assert apart.max() < (0.1 if shape == models.SPHERE else 0.55)
    assert apart.mean() < 0.03
    assert abs(found.sum() / wanted.sum() - 1) < (0.01 if shape == models.SPHERE else 0.08)


@pytest.mark.parametrize(("shape", "taper"), SOLIDS)
def test_rays_that_miss_cover_nothing(shape: int, taper: float):
    away = grid(8, 0.1) + np.array([0, 0.8, 0])
    assert (hits(shape, taper, ORIGIN, away, 0.01)[:, 0] == 0).all()
