"""A bridge's hull against SciPy's, and against points that must lie in it or beside it."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from thalweg.world import bridges
from thalweg.world.bridges import Bridge

ROW = np.array(
    Bridge(
        x=10.0,
        y=-4.0,
        angle=0.7,
        length=12.0,
        width=3.0,
        span=6.6,
        spring_z=1.1,
        rise=1.65,
        deck_z=3.2,
        hump=0.3,
        parapet=0.6,
    )
)


def hull_vertices(row: np.ndarray) -> np.ndarray:
    """[K, 3] float64: the corners of the bridge's convex hull."""
    bridge = Bridge(*row)
    bottom = bridge.spring_z - bridges.FOOT_M
    profile = np.concatenate([bridges.top_profile(row), [[bridge.length / 2, bottom], [-bridge.length / 2, bottom]]])
    cos, sin = np.cos(bridge.angle), np.sin(bridge.angle)
    sides = []
    for v in (-bridge.width / 2, bridge.width / 2):
        x = bridge.x + cos * profile[:, 0] - sin * v
        y = bridge.y + sin * profile[:, 0] + cos * v
        sides.append(np.stack([x, y, profile[:, 1]], axis=1))
    return np.concatenate(sides)


def inside(points: np.ndarray) -> np.ndarray:
    planes = bridges.hull_planes(ROW)
    return np.all(points @ planes[:, :3].T <= planes[:, 3] + 1e-9, axis=1)


def in_world(u: float, v: float, z: float) -> np.ndarray:
    cos, sin = np.cos(0.7), np.sin(0.7)
    return np.array([[10.0 + cos * u - sin * v, -4.0 + sin * u + cos * v, z]])


def test_planes_have_unit_normals():
    planes = bridges.hull_planes(ROW)
    assert planes.shape == (14, 4)
    np.testing.assert_allclose(np.linalg.norm(planes[:, :3], axis=1), 1.0)


def test_planes_are_those_of_scipys_hull_of_the_corners():
    equations = ConvexHull(hull_vertices(ROW)).equations * [1, 1, 1, -1]
    planes = bridges.hull_planes(ROW)
    apart = np.abs(equations[:, None, :] - planes[None, :, :]).max(axis=2)
    assert apart.min(axis=1).max() < 1e-9
    assert apart.min(axis=0).max() < 1e-9


@pytest.mark.parametrize(
    ("u", "v", "z"),
    [(0, 0, 2.0), (0, 1.49, 3.79), (0, 0, 1.2), (5.99, 1.49, 3.49), (-5.99, -1.49, 3.49), (3.0, 1.49, 3.72)],
)
def test_body_parapets_and_the_air_under_the_arch_are_in_the_hull(u, v, z):
    assert inside(in_world(u, v, z))[0]


@pytest.mark.parametrize("u_v_z", [(0, 0, 3.81), (0, 1.51, 2.0), (6.01, 0, 2.0), (0, 0, 0.09), (5.99, 0, 3.56)])
def test_points_beside_and_above_are_outside(u_v_z):
    assert not inside(in_world(*u_v_z))[0]


def test_the_hull_covers_the_parapets_closely():
    u = np.linspace(-6.0, 6.0, 400)
    top = bridges.hull_top(ROW, 10.0 + np.cos(0.7) * u, -4.0 + np.sin(0.7) * u, 1e-9)
    gap = top - (3.2 + 0.6 - 0.3 * (u / 6.0) ** 2)
    assert gap.min() > -1e-9
    assert gap.max() < 0.3 / 8**2 + 1e-9


def test_hull_top_is_absent_beside_the_bridge_and_grows_with_the_body():
    beside = in_world(0.0, 1.6, 0.0)[0]
    assert bridges.hull_top(ROW, beside[:1], beside[1:2])[0] == -np.inf
    assert bridges.hull_top(ROW, beside[:1], beside[1:2], 0.25)[0] == pytest.approx(3.8)


def test_the_causeway_meets_the_ends_of_the_deck_and_falls_away():
    ends = np.concatenate([in_world(6.0, 0, 0), in_world(8.0, 0, 0), in_world(6.0, 2.8, 0)])
    heights = bridges.causeway(ROW, ends[:, 0], ends[:, 1])
    np.testing.assert_allclose(heights, [2.88, 2.88 - 0.36, 2.88 - 0.75])


def test_a_bridge_across_a_river_stands_at_right_angles_with_its_deck_above_the_water():
    row = Bridge(*bridges.bridge_across(np.array([1.0, 2.0]), np.array([0.0, 1.0]), 5.0, 7.0, np.random.default_rng(0)))
    assert (np.cos(row.angle), np.sin(row.angle)) == (pytest.approx(-1.0), pytest.approx(0.0, abs=1e-12))
    assert row.deck_z == pytest.approx(9.2)
    assert row.length == pytest.approx(5.0 + 2 * 2.6)
    assert row.spring_z + row.rise < row.deck_z - row.hump
