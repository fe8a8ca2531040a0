"""Tests of ripples under wind: they grow by Cox and Munk's law, move with the wind, and are as before without it."""

import numpy as np
import pytest
import torch

from tests.render.plain import plane
from thalweg.render import Camera, Look, Renderer
from thalweg.render.errors import RenderError
from thalweg.render.records.appearance import (
    DRIFT_A_M_PER_S,
    DRIFT_A_X,
    DRIFT_A_Y,
    DRIFT_B_X,
    DRIFT_B_Y,
    RIPPLE,
    RIPPLE_1,
    look_rows,
    look_values,
)
from thalweg.render.records.breeze import ruffle

CAMERA = Camera(32, 32)
POSES = np.array([[-10.0, 0.0, 3.0, 0.0]])


def rows_of(*looks: Look) -> np.ndarray:
    return look_rows(look_values(looks, len(looks)), CAMERA)


def blown(east: float, north: float, look: Look | None = None) -> np.ndarray:
    """The row of a look under a wind."""
    rows = rows_of(look or Look())
    ruffle(rows, np.array([east]), np.array([north]))
    return rows[0]


def test_no_wind_changes_no_bit():
    rows = rows_of(Look(), Look(ripple=4.0), Look(ripple=0.3, clouds=0.7))
    kept = rows.copy()
    ruffle(rows, np.zeros(3), np.zeros(3))
    np.testing.assert_array_equal(rows, kept)


def test_slopes_grow_by_the_law_of_cox_and_munk():
    for speed in (1.0, 3.0, 6.0):
        mean_square = 0.003 + 0.00512 * speed
        assert blown(0.6 * speed, -0.8 * speed)[RIPPLE] == pytest.approx(RIPPLE_1 * np.sqrt(mean_square / 0.005))
    assert blown(6.0, 0.0, Look(ripple=1.8))[RIPPLE] == pytest.approx(RIPPLE_1 * 4.0)  # the steepest that a look allows


@pytest.mark.parametrize("angle", [0.0, 1.0, 2.5, -2.0])
def test_both_layers_move_with_the_wind(angle: float):
    row = blown(3.0 * np.cos(angle), 3.0 * np.sin(angle))
    # The pattern moves against the velocity at which its tile is read; the second layer's axes are turned back.
    first = -row[[DRIFT_A_X, DRIFT_A_Y]]
    turned = -row[[DRIFT_B_X, DRIFT_B_Y]]
    second = np.array([0.6 * turned[0] - 0.8 * turned[1], 0.8 * turned[0] + 0.6 * turned[1]])
    assert np.hypot(*first) == pytest.approx(np.hypot(*DRIFT_A_M_PER_S))
    middle = first / np.hypot(*first) + second / np.hypot(*second)
    assert np.angle(complex(*middle) * np.exp(-1j * angle)) == pytest.approx(0.0, abs=1e-6)


def test_tensors_are_ruffled_as_arrays():
    rows, wind = rows_of(Look(), Look(ripple=2.0)), np.array([[3.0, -1.0], [0.0, 0.0]])
    tensors = torch.from_numpy(rows.copy())
    ruffle(rows, *wind.T)
    ruffle(tensors, *torch.from_numpy(wind).T)
    np.testing.assert_allclose(tensors.numpy(), rows, rtol=1e-6)


@pytest.mark.parametrize("wind", [[1.0, 2.0], [[1.0]], [[np.nan, 0.0]]])
def test_a_wrong_wind_is_refused(wind: list):
    with pytest.raises(
        RenderError, match=r"wind has shape .*; it must be \[1, 2\] in m/s east and north, within ±1000"
    ):
        Renderer([plane(water_level=0.5)], CAMERA).render(POSES, wind=wind)


def test_frames_show_the_wind_on_the_water_and_nothing_of_no_wind():
    renderer = Renderer([plane(slope_x=-0.03, water_level=0.5)], CAMERA)
    calm = renderer.render(POSES, time_s=3.0)
    np.testing.assert_array_equal(renderer.render(POSES, time_s=3.0, wind=[[0.0, 0.0]]), calm)
    windy = renderer.render(POSES, time_s=3.0, wind=[[4.0, 0.0]])
    water = calm[0, ..., 3] > 0
    changed = (windy[0, ..., :3] != calm[0, ..., :3]).any(axis=-1)
    np.testing.assert_array_equal(windy[..., 3], calm[..., 3])
    assert changed[water].mean() > 0.5
    assert not np.array_equal(windy, renderer.render(POSES, time_s=3.0, wind=[[0.0, 4.0]]))
