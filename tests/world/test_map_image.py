"""Tests of the map picture: a readable PNG with everything at its position, written atomically."""

import math
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.patches import Rectangle
from PIL import Image

from tests.world.valley import valley
from thalweg.world import map_image as drawing
from thalweg.world.banks import read_banks
from thalweg.world.generate.plants import scatter
from thalweg.world.generate.surface import paint
from thalweg.world.light.bake import bake
from thalweg.world.record import River, World


@pytest.fixture(scope="module")
def world() -> World:
    """A straight enough piece of the test valley as a whole world, with a bridge and an island."""
    grid, ground, water, shore, clear = valley(240)
    x = np.linspace(-25.0, 25.0, 40)
    line = np.stack([x, 7.2 * np.sin(2.0 * math.pi * x / 36.0)], axis=1)
    step = np.gradient(line, axis=0)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    river = River(
        closed=False,
        position_m=line,
        arc_m=arc,
        length_m=float(arc[-1]),
        tangent=step / np.linalg.norm(step, axis=1, keepdims=True),
        width_m=np.full(40, 8.0),
        depth_m=np.full(40, 1.2),
        level_m=np.zeros(40),
    )
    bridges = np.array([[12.0, 20.0, 0.0, 16.0, 5.0, 9.0, 0.2, 1.4, 2.2, 0.1, 0.5]])
    plants = scatter(grid, ground, water, shore, clear, 1.0, np.random.default_rng(1))
    baked = bake(grid, ground, water, plants, bridges, 2.0, math.radians(55.0))
    return World(
        name="Valley",
        seed=3,
        river=river,
        islands=np.array([[-10.0, -20.0, 4.0, 2.0, 0.3]]),
        bridges=bridges,
        grid=grid,
        ground_m=ground,
        water_m=water,
        albedo=paint(grid, ground, water, shore, np.random.default_rng(2)),
        sun=baked.sun,
        sky=baked.sky,
        canopy_m=baked.canopy_m,
        plants=plants,
        sun_azimuth=2.0,
        sun_elevation=math.radians(55.0),
    )


def test_longer_side_has_the_requested_pixels(world, tmp_path):
    drawing.draw(world, tmp_path / "maps" / "valley.png", size_px=600)
    with Image.open(tmp_path / "maps" / "valley.png") as picture:
        assert picture.format == "PNG"
        assert max(picture.size) == pytest.approx(600, abs=2)


def test_bridge_is_drawn_where_it_stands_and_north_is_up(world, tmp_path):
    drawing.draw(world, tmp_path / "map.png", size_px=700)
    picture = np.asarray(Image.open(tmp_path / "map.png").convert("RGB")).astype(int)
    edge = np.abs(picture - (228, 87, 46)).max(axis=2) < 60
    edge[len(edge) // 2 :] = False
    row, column = np.nonzero(edge)
    height, width = picture.shape[:2]
    assert 0.5 * (column.min() + column.max()) / width == pytest.approx(0.5 + 12.0 / 60.0, abs=0.02)
    assert 0.5 * (row.min() + row.max()) / height == pytest.approx(0.5 - 20.0 / 60.0, abs=0.06)


def test_a_marker_is_drawn_over_a_bridge(world):
    place = [np.interp(50.0, world.river.arc_m, column) for column in world.river.position_m.T]
    bridge = np.array([[*place, 0.5 * math.pi, 16.0, 8.0, 9.0, 0.2, 1.4, 2.2, 0.1, 0.5]])
    figure = drawing._figure(replace(world, bridges=bridge), 1200)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    column, row = figure.axes[0].transData.transform(place)
    picture = np.asarray(canvas.buffer_rgba())[::-1].astype(int)
    np.testing.assert_array_equal(picture[int(row), int(column), :3], (255, 255, 255))
    deck = picture[int(row), int(column) + 20, :3]
    assert np.abs(deck - (203, 191, 168)).max() < 25
    number = next(text for text in figure.axes[0].texts if text.get_text() == "50")
    assert all(number.get_zorder() > patch.get_zorder() for patch in figure.axes[0].patches)


def test_the_scale_bar_is_as_long_as_its_end_says_and_both_halves_are_outlined(world):
    figure = drawing._figure(world, 1200)
    white, dark = (patch for patch in figure.axes[0].patches if isinstance(patch, Rectangle))
    assert white.get_x() + white.get_width() == pytest.approx(dark.get_x())
    assert white.get_width() + dark.get_width() == pytest.approx(10.0)  # metres, on a map of 60 m
    labels = {text.get_text(): text.get_position()[0] for text in figure.axes[0].texts}
    assert labels["0"] == white.get_x() and labels["10 m"] == pytest.approx(dark.get_x() + dark.get_width())
    assert {to_hex(patch.get_edgecolor()) for patch in (white, dark)} == {"#ffffff"}
    assert to_hex(white.get_facecolor()) != to_hex(dark.get_facecolor())


@pytest.mark.parametrize("columns", [240, 100])
def test_a_map_is_drawn_in_the_scale_that_is_asked_for(world, columns):
    cut = {
        name: getattr(world, name)[:, :columns] for name in ("ground_m", "water_m", "sun", "sky", "canopy_m", "albedo")
    }
    narrow = replace(world, **cut)
    figure = drawing._figure(narrow, drawing.size_in_scale(narrow, 12.0))
    assert figure.axes[0].bbox.width == pytest.approx(12.0 * columns * world.grid.cell_m, rel=2e-3)


def test_the_deck_of_a_bridge_has_its_length_along_and_its_width_across():
    corners = drawing.deck(np.array([1.0, 2.0, 0.5 * math.pi, 16.0, 8.0, 9.0, 0.2, 1.4, 2.2, 0.1, 0.5]))
    np.testing.assert_allclose(corners, [[5, -6], [5, 10], [-3, 10], [-3, -6]], atol=1e-12)


def test_north_of_the_ground_is_up(world, tmp_path):
    albedo = np.zeros_like(world.albedo)
    albedo[120:] = 255
    bare = replace(world, albedo=albedo, canopy_m=np.maximum(world.ground_m, world.water_m))
    drawing.draw(bare, tmp_path / "map.png", size_px=400)
    rows = np.asarray(Image.open(tmp_path / "map.png").convert("L")).mean(axis=1)
    assert rows[50:150].mean() > 2.0 * rows[250:350].mean()


def test_sand_is_brighter_than_water_and_forest(world):
    brightness = drawing.view(world).astype(float).mean(axis=2)
    depth = world.water_m - world.ground_m
    rise = world.canopy_m - np.maximum(world.ground_m, world.water_m)
    bare = (depth < -0.1) & (depth > -0.5) & (rise < 0.1) & (world.sun > 200)
    assert brightness[bare].mean() > 1.4 * brightness[depth > 0.8].mean()
    assert brightness[bare].mean() > 1.8 * brightness[rise > 5.0].mean()


def test_a_failed_write_keeps_the_old_picture_and_no_other_file(world, tmp_path, monkeypatch):
    path = tmp_path / "map.png"
    path.write_bytes(b"old")

    def fail(self, file, **rest):
        file.write(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(drawing.FigureCanvasAgg, "print_png", fail)
    with pytest.raises(OSError, match="disk full"):
        drawing.draw(world, path, size_px=400)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["map.png"]


def test_a_tiny_map_is_an_error(world, tmp_path):
    with pytest.raises(ValueError, match="300 pixels"):
        drawing.draw(world, tmp_path / "map.png", size_px=50)
    assert not list(tmp_path.iterdir())


def test_a_name_is_written_literally_and_a_narrow_map_keeps_its_legend(world, tmp_path):
    narrow = replace(world, name="Dora $x_", ground_m=world.ground_m[:, :80], water_m=world.water_m[:, :80])
    narrow = replace(narrow, albedo=world.albedo[:, :80], sun=world.sun[:, :80], sky=world.sky[:, :80])
    figure = drawing._figure(replace(narrow, canopy_m=world.canopy_m[:, :80]), 1200)
    renderer = FigureCanvasAgg(figure).get_renderer()
    legend = figure.legends[0].get_window_extent(renderer)
    assert legend.x0 >= 0 and legend.x1 <= figure.bbox.width
    name, facts = (text.get_window_extent(renderer) for text in figure.texts)
    assert not name.overlaps(facts) and facts.x1 <= figure.bbox.width
    assert not any(text.get_parse_math() for text in figure.texts if "$" in text.get_text())


def test_the_title_names_the_kinds_of_banks_without_their_reaches(world):
    banks = read_banks("meadow+quay_60-110_left+reeds_60-110_right+quay_180-230")
    assert drawing.short_name(replace(world, name="Medium+meadow+quay_60-110_left", banks=banks)) == (
        "Medium+meadow+quay+reeds"
    )
    assert drawing.short_name(replace(world, name="a+b.geojson")) == "a+b.geojson"
    assert drawing.short_name(replace(world, name="Cam", banks=banks)) == "Cam"
