"""Tests of frames behind a lens, by points in space that OpenCV's formulas, written out here, put onto pixels."""

import math
from typing import Any

import numpy as np
import pytest

from tests.render.lake import ALL, lake
from tests.render.lake import POSE as LAKE_POSE
from tests.render.plain import plane
from thalweg.core.compute.threads import get_num_threads, set_num_threads
from thalweg.render import Camera, Look, Renderer, RenderError, lens_drawing, renderer
from thalweg.render.optics.lens import Lens
from thalweg.render.records.classes import BRIDGE, GROUND, WATER

POSE = np.array([[0.0, 1.0, 4.0, -0.2]])
WORLD = plane(slope_y=0.06, water_level=0.25)
"""Its shore is the line y = 0.25 / 0.06."""
BARREL = Lens("plumb_bob", (-0.28, 0.09, 0.002, -0.003, -0.01), 0.97, 6.5, -4.25)
PINCUSHION = Lens("plumb_bob", (0.25, 0.05))
RATIONAL = Lens("rational_polynomial", (0.5, 0.1, 0.001, 0.002, 0.01, 0.8, 0.2, 0.03), 1.05, -3.0, 2.0)
FISHEYE = Lens("equidistant", (-0.03, 0.006, -0.002, 0.0003), 1.0, 2.0, 3.0)
LENSES = {"barrel": BARREL, "pincushion": PINCUSHION, "rational": RATIONAL, "fisheye": FISHEYE}


def shown_by_formula(camera: Camera, points: np.ndarray, look: Look) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns, rows and depths of points [K, 3] by the formulas of OpenCV's pages, from K, R, t and coefficients."""
    matrix, rotation, translation = camera.camera_matrices(POSE, look.pitch_deg, look.fov_deg)
    model, coefficients = camera.distortion(look.fov_deg)
    px, py, pz = rotation[0] @ points.T + translation[0][:, None]
    pz = np.where(pz > 0.5, pz, np.nan)
    a, b = px / pz, py / pz
    r2 = a**2 + b**2
    if model == "equidistant":
        k1, k2, k3, k4 = coefficients
        r = np.sqrt(r2)
        theta = np.arctan(r)
        theta_d = theta + k1 * theta**3 + k2 * theta**5 + k3 * theta**7 + k4 * theta**9
        a, b = theta_d / r * a, theta_d / r * b
    else:
        k1, k2, p1, p2, k3, k4, k5, k6 = np.pad(coefficients, (0, 8 - len(coefficients)))
        radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
        moved = a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a**2), b * radial + p1 * (r2 + 2 * b**2) + 2 * p2 * a * b
        a, b = (np.where(r2 < 2.2, each, np.nan) for each in moved)
    return matrix[0, 0, 0] * a + matrix[0, 0, 2], matrix[0, 1, 1] * b + matrix[0, 1, 2], pz


@pytest.mark.parametrize("look", [Look(), Look(pitch_deg=-4.0, fov_deg=6.0)], ids=["as calibrated", "wider"])
@pytest.mark.parametrize("name", LENSES)
def test_points_of_the_world_have_their_depth_where_the_formula_puts_them(name: str, look: Look):
    camera = Camera(96, 128, lens=LENSES[name])
    if name == "fisheye" and look.fov_deg:
        with pytest.raises(RenderError, match="looks without fov_deg"):
            camera.distortion(look.fov_deg)
        return
    layers = Renderer([WORLD], camera).render_layers(POSE, look=look, layers=("depth_m", "class_id"))
    random = np.random.default_rng(0)
    # Denser near the camera, where a pixel sees less of the ground.
    away, angle = np.exp(random.uniform(-0.7, 3.7, 1_000_000)), random.uniform(-1.8, 1.4, 1_000_000)
    x, y = away * np.cos(angle), 1.0 + away * np.sin(angle)
    points = np.column_stack([x, y, np.maximum(0.06 * y, 0.25)])
    u, v, depth = shown_by_formula(camera, points, look)
    with np.errstate(invalid="ignore"):
        near = (np.abs(u - np.rint(u)) < 0.04) & (np.abs(v - np.rint(v)) < 0.04)
        seen = near & (u > -0.5) & (u < 127.5) & (v > -0.5) & (v < 95.5) & (depth < 25)
    row, column = np.rint(v[seen]).astype(int), np.rint(u[seen]).astype(int)
    shore = np.abs(y[seen] - 0.25 / 0.06) > 1.0
    found, kind = layers.depth_m[0, row, column], layers.class_id[0, row, column]
    assert len(set(zip(row, column, strict=True))) > 1000 and row.max() > 90
    assert column.min() < 12 and column.max() > 120
    np.testing.assert_allclose(found[shore], depth[seen][shore], rtol=0.01)
    np.testing.assert_array_equal((kind == WATER)[shore], (points[seen, 1] < 0.25 / 0.06)[shore])


@pytest.mark.parametrize("name", LENSES)
def test_the_shore_is_within_half_a_pixel_of_where_the_formula_puts_it(name: str):
    camera = Camera(96, 128, lens=LENSES[name])
    layers = Renderer([WORLD], camera).render_layers(POSE, layers=("class_id", "depth_m"))
    kind, near = layers.class_id[0], layers.depth_m[0] < 30
    x = np.linspace(-49, 49, 20001)
    line = np.column_stack([x, np.full_like(x, 0.25 / 0.06), np.full_like(x, 0.25)])
    u, v, depth = shown_by_formula(camera, line, Look())
    with np.errstate(invalid="ignore"):
        seen = (u > -2) & (u < 129) & (v > -2) & (v < 97) & (depth > 0.5)
    u, v = u[seen], v[seen]
    # Between two pixels of a column, land above and water below, or the reverse, the shore passes.
    pair = np.minimum(kind[:-1], kind[1:]), np.maximum(kind[:-1], kind[1:])
    tops, columns = np.nonzero((pair[0] == WATER) & (pair[1] == GROUND) & near[:-1] & near[1:])
    order = np.argsort(u)
    u, v = u[order], v[order]
    slope = np.interp(columns, u, np.gradient(v, u))
    # Across the shore, between two pixels one above the other, and on the whole without an offset.
    away = (np.interp(columns, u, v) - tops - 0.5) / np.hypot(1.0, slope)
    assert len(away) > 30 and np.abs(away).max() < 0.6 and np.mean(np.abs(away) < 0.5) > 0.9
    assert abs(away.mean()) < 0.1
    bent = np.polyfit(u, v, 1)
    assert np.abs(np.polyval(bent, u) - v).max() > 0.5  # a straight line is none in such an image


def test_an_offset_of_the_axis_shows_the_part_of_a_larger_frame():
    focal = 64 / math.tan(math.radians(30))
    larger = Camera(128 + 20, 128 + 20, fov_deg=math.degrees(2 * math.atan(74 / focal)))
    whole = Renderer([WORLD], larger).render_layers(POSE)
    moved = Renderer([WORLD], Camera(lens=Lens(offset_x_px=-10.0, offset_y_px=6.0))).render_layers(POSE)
    # The axis is at column 73.5 of the larger frame and at 53.5 of this one, and at rows 73.5 and 69.5.
    rows, columns = slice(4, 132), slice(20, 148)
    assert (moved.class_id[0] == whole.class_id[0, rows, columns]).mean() > 0.998
    same = (moved.class_id[0] == whole.class_id[0, rows, columns]) & (np.abs(moved.depth_m[0] - 25) < 25)
    # Pixels beside the shore have the depth of the nearest texel.
    ratio = moved.depth_m[0][same] / whole.depth_m[0, rows, columns][same]
    assert np.abs(ratio - 1).max() < 0.02 and np.mean(np.abs(ratio - 1) < 1e-3) > 0.99
    colours = moved.rgb[0].astype(float) / moved.rgb[0].mean(), whole.rgb[0, rows, columns].astype(float)
    assert np.abs(colours[0] - colours[1] / colours[1].mean()).mean() < 0.04


def test_a_lens_without_distortion_draws_what_a_pinhole_does():
    plain, behind = (Renderer([WORLD], Camera(lens=lens)).render_layers(POSE) for lens in (None, Lens()))
    assert (plain.class_id == behind.class_id).mean() > 0.998
    near = plain.depth_m < 50
    np.testing.assert_allclose(plain.depth_m[near], behind.depth_m[near], rtol=0.02)
    difference = behind.rgb.astype(float) - plain.rgb
    assert np.abs(difference).mean() < 2.5 and np.abs(difference.mean()) < 1.0


def test_frames_do_not_depend_on_batch_threads_and_what_else_is_drawn(monkeypatch: pytest.MonkeyPatch):
    poses = np.array([[0.0, 1.0, 4.0, 0.3], [-8.0, -2.0, 6.5, 2.6], [5.0, 4.0, 3.0, -1.4]])
    drawn = Renderer([WORLD], Camera(48, 64, lens=BARREL))
    looks = [Look(noise=4.0), Look(fov_deg=5.0), Look(haze=2.0)]
    frames = drawn.render(poses, time_s=[0.0, 1.0, 2.0], look=looks)
    monkeypatch.setattr(lens_drawing, "FRAMES_PER_THREAD", 1)
    before = get_num_threads()
    set_num_threads(1)
    try:
        alone = [drawn.render(poses[n : n + 1], time_s=float(n), look=looks[n])[0] for n in range(3)]
        together = drawn.render(poses, time_s=[0.0, 1.0, 2.0], look=looks)
        layers = drawn.render_layers(poses, look=looks, layers=("depth_m", "mask"))
    finally:
        set_num_threads(before)
    np.testing.assert_array_equal(frames, alone)
    np.testing.assert_array_equal(frames, together)
    np.testing.assert_array_equal(frames[..., 3], drawn.render_mask(poses, look=looks))
    np.testing.assert_array_equal(frames[..., 3] > 0, layers.mask)


def test_the_fast_quality_has_the_same_mask():
    full, fast = (Renderer([WORLD], Camera(48, 64, lens=BARREL), quality).render(POSE) for quality in ("full", "fast"))
    assert (full[..., 3] == fast[..., 3]).mean() > 0.995
    assert np.abs(full[..., :3].astype(float) - fast[..., :3]).mean() < 15


def test_a_gpu_is_refused(monkeypatch: pytest.MonkeyPatch):
    on_gpu: Any = lambda _: "cuda:0"  # noqa: E731
    monkeypatch.setattr(renderer, "resolve_device", on_gpu)
    with pytest.raises(RenderError, match=r"has a lens, which is drawn on the CPU only, not on cuda:0: .*rectify"):
        Renderer([WORLD], Camera(lens=BARREL), device="cuda")


def test_each_frame_behind_a_lens_has_its_own_props(monkeypatch: pytest.MonkeyPatch):
    drawn = Renderer([lake()], Camera(48, 64, lens=BARREL))
    props = np.stack([ALL[0], np.zeros_like(ALL[0]), ALL[0][1:2].repeat(len(ALL[0]), axis=0)])
    monkeypatch.setattr(lens_drawing, "MOST_BYTES", 1)  # one frame at a time
    together = drawn.render_layers(np.repeat(LAKE_POSE, 3, axis=0), props=props)
    for n in range(3):
        alone = drawn.render_layers(LAKE_POSE, props=props[n : n + 1])
        np.testing.assert_array_equal(together.class_id[n], alone.class_id[0])
        np.testing.assert_array_equal(together.rgb[n], alone.rgb[0])
    assert [(kinds > BRIDGE).any() for kinds in together.class_id] == [True, False, True]
