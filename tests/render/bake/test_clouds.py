"""Tests of the map of clouds: its fields, its cover, its seeds and its light."""

import numpy as np
import pytest

from thalweg.render.bake import clouds


def sun(elevation_deg: float, azimuth: float = 0.0) -> np.ndarray:
    level = np.cos(np.radians(elevation_deg))
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(np.radians(elevation_deg))])


def directions() -> np.ndarray:
    """[SIDE, SIDE, 3] unit vectors towards the texels of the map."""
    middle = (np.arange(clouds.SIDE) + 0.5) / clouds.SIDE * 2 - 1
    x, y = np.meshgrid(middle, middle)
    square = x**2 + y**2
    return np.stack([2 * x, 2 * y, 1 - square], axis=-1) / (1 + square)[..., None]


@pytest.fixture(scope="module")
def overcast() -> np.ndarray:
    return clouds.cloud_map(sun(50.0), 3)


def test_a_map_depends_on_the_seed_and_the_sun_alone_and_stays_within_its_range(overcast):
    np.testing.assert_array_equal(clouds.cloud_map(sun(50.0), 3), overcast)
    other = clouds.cloud_map(sun(50.0), 4)
    assert np.mean(np.abs(other[..., 0] - overcast[..., 0]) > 0.05) > 0.3
    lower = clouds.cloud_map(sun(30.0, 2.0), 3)
    # The sun changes the light on a cloud, not the cloud.
    np.testing.assert_array_equal(lower[..., [0, 2, 3]], overcast[..., [0, 2, 3]])
    assert np.mean(np.abs(lower[..., 1] - overcast[..., 1]) > 0.1) > 0.05
    assert overcast.min() >= 0
    assert overcast[..., 1:].max() <= 1
    assert overcast[..., 0].max() < 1.4
    coded = clouds.packed(overcast).reshape(clouds.SIDE, clouds.SIDE)
    np.testing.assert_allclose((coded >> 8 & 255) / 255, overcast[..., 1], atol=0.002)


def test_no_cloud_shows_at_the_horizon_and_all_do_high_above_it(overcast):
    up = directions()[..., 2]
    assert (overcast[up <= clouds.LOW][:, 2:] == 0).all()
    assert (overcast[up >= clouds.CLEAR][:, 3] == 1).all()


@pytest.mark.parametrize("cover", [0.1, 0.3, 0.6])
def test_the_share_of_the_field_above_the_threshold_is_about_the_cover(cover):
    cumulus, billows, _ = clouds.fields()
    assert np.mean(cumulus > 1 - cover) == pytest.approx(cover, abs=0.001)
    assert np.mean(cumulus + billows + np.roll(billows, 300, 0) > 1 - cover) == pytest.approx(cover, abs=0.06)


def test_the_bulges_never_exceed_what_the_march_leaves_out():
    assert 2 * clouds.fields()[1].max() <= clouds.BULGE


def test_clouds_are_brighter_away_from_a_low_sun_than_before_it():
    found = directions()
    low = (found[..., 2] > 0.2) & (found[..., 2] < 0.5)
    before, away = [], []
    for seed in range(3):
        baked = clouds.cloud_map(sun(30.0), seed)
        cloudy = low & (baked[..., 0] > 1 - clouds.COVER_LIT)
        towards = found[..., 0] / np.hypot(found[..., 0], found[..., 1])
        before.append(baked[..., 1][cloudy & (towards > 0.7)].mean())
        away.append(baked[..., 1][cloudy & (towards < -0.7)].mean())
    assert np.mean(away) > np.mean(before) + 0.1
