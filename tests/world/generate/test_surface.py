"""Tests of the painted ground: bands, detail at every scale and no noise of single nodes."""

import numpy as np
import pytest

from tests.world.valley import valley
from thalweg.world.generate.surface import paint
from thalweg.world.noise import fractal, smooth_step


@pytest.fixture(scope="module")
def painted():
    grid, ground, water, shore, _ = valley(512)
    albedo = paint(grid, ground, water, shore, np.random.default_rng(3))
    return grid, ground, water, shore, albedo


def linear(albedo: np.ndarray) -> np.ndarray:
    return (albedo / 255.0) ** 2


def radial_slope(image: np.ndarray, low: int, high: int) -> float:
    """Exponent of the power spectrum of a square image between two frequencies, in cycles per image."""
    window = np.hanning(len(image))
    power = np.abs(np.fft.fft2((image - image.mean()) * window[:, None] * window[None, :])) ** 2
    cycles = np.fft.fftfreq(len(image), 1.0 / len(image))
    radius = np.hypot(cycles[:, None], cycles[None, :]).round().astype(int)
    radial = np.bincount(radius.ravel(), power.ravel()) / np.bincount(radius.ravel())
    k = np.arange(low, high)
    return float(np.polyfit(np.log(k), np.log(radial[k]), 1)[0])


@pytest.mark.parametrize("octaves", [1, 3])
def test_noise_has_no_mean_and_unit_deviation(octaves):
    fields = [fractal((400, 400), 0.25, 6.0, octaves, np.random.default_rng(seed)) for seed in range(4)]
    assert np.mean(fields) == pytest.approx(0.0, abs=0.05)
    assert np.std(fields) == pytest.approx(1.0, abs=0.06)


def test_octaves_shorter_than_two_nodes_are_left_out():
    few = fractal((64, 64), 0.25, 2.0, 3, np.random.default_rng(0))
    many = fractal((64, 64), 0.25, 2.0, 12, np.random.default_rng(0))
    assert np.array_equal(few, many)


def test_noise_is_correlated_only_within_a_wavelength():
    field = fractal((600, 600), 0.25, 10.0, 1, np.random.default_rng(1))
    lag = lambda d: float(np.mean(field[:, d:] * field[:, :-d]))  # noqa: E731
    assert lag(4) > 0.85
    assert abs(lag(80)) < 0.15


def test_smooth_step_at_its_ends_and_middle():
    assert np.allclose(smooth_step(1.0, 3.0, np.array([0.0, 1.0, 1.5, 2.0, 3.0, 9.0])), [0, 0, 0.15625, 0.5, 1, 1])


def test_dry_sand_is_pale_and_warm(painted):
    *_, shore, albedo = painted
    sand = linear(albedo)[(shore > 1.5) & (shore < 2.2)].mean(axis=0)
    assert sand == pytest.approx([0.52, 0.42, 0.30], abs=0.06)


def test_wet_sand_is_much_darker_than_the_dry_rim(painted):
    *_, shore, albedo = painted
    brightness = linear(albedo).mean(axis=2)
    wet = np.quantile(brightness[(shore > 0.05) & (shore < 0.2)], 0.25)  # the wet edge is ragged, a node wide or two
    rim = brightness[(shore > 0.5) & (shore < 0.9)].mean()
    assert wet < 0.62 * rim


def test_forest_floor_is_darker_than_grass_and_grass_than_sand(painted):
    *_, shore, albedo = painted
    brightness = linear(albedo).mean(axis=2)
    sand, grass, litter = (brightness[(shore > a) & (shore < b)].mean() for a, b in ((1, 2), (7.0, 8.0), (20, 40)))
    assert litter < 0.8 * grass < 0.6 * sand


def test_bed_grows_darker_with_depth(painted):
    _, ground, water, _, albedo = painted
    depth, brightness = water - ground, linear(albedo).mean(axis=2)
    shallow = brightness[(depth > 0.15) & (depth < 0.4)].mean()
    deep = brightness[depth > 1.1].mean()
    assert deep < 0.65 * shallow


def test_steep_ground_shows_earth_instead_of_grass():
    grid, ground, water, shore, _ = valley(256)
    cliff = ground + np.where(shore > 8.0, 1.6 * (shore - 8.0), 0.0).astype(np.float32)
    place = (shore > 10.0) & (shore < 14.0)
    flat = linear(paint(grid, ground, water, shore, np.random.default_rng(3)))[place].mean(axis=0)
    steep = linear(paint(grid, cliff, water, shore, np.random.default_rng(3)))[place].mean(axis=0)
    assert steep[0] > 1.4 * flat[0]
    assert steep[0] / steep[2] < 2.2


def test_spectrum_falls_at_every_scale_but_not_into_flatness(painted):
    luminance = linear(painted[-1])[:256, :256] @ np.array([0.2126, 0.7152, 0.0722])
    assert -3.4 < radial_slope(luminance, 4, 24) < -1.2
    assert -3.6 < radial_slope(luminance, 24, 100) < -1.6


def test_no_two_neighbouring_metres_are_flat(painted):
    brightness = linear(painted[-1]).mean(axis=2)
    blocks = brightness.reshape(64, 8, 64, 8).transpose(0, 2, 1, 3).reshape(64, 64, -1)
    assert (blocks.std(axis=2) / blocks.mean(axis=2)).min() > 0.03


def test_same_seed_same_bytes_and_another_seed_another_ground(painted):
    grid, ground, water, shore, albedo = painted
    assert np.array_equal(albedo, paint(grid, ground, water, shore, np.random.default_rng(3)))
    assert np.mean(albedo != paint(grid, ground, water, shore, np.random.default_rng(4))) > 0.5
