"""Tests of films of flights and of their maps."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from tests.env.handmade import ring
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, Step, evaluate
from thalweg.bench.pictures import film
from thalweg.bench.pictures.film import (
    AROUND_M,
    FRAMES_PER_S,
    HOLD_S,
    START,
    VEHICLE,
    Flight,
    RiverMap,
    inset_box,
    shows_river,
    smooth,
    write_film,
)
from thalweg.bench.pictures.film_format import BLOCK_PX, FILM_COMMENT, LARGE, MARGIN_PX, SMALL, FilmFormat, format_of
from thalweg.core.video import comment_of, read_video
from thalweg.env import sample_starts
from thalweg.render import Camera
from thalweg.world import World


def flight_on(world: World, steps: int) -> Flight:
    starts = sample_starts(world, 1, 0)
    recorded: list[Step] = []
    course = Course(world, starts, np.zeros(1), np.zeros(1, dtype=np.int64))
    (episode,) = evaluate(
        BASELINES["pilot"], course, Label("pilot", 0, "Easy"), EvaluationConfig(), on_step=recorded.append
    )
    flight = Flight.from_steps(episode, recorded)
    return Flight(episode, flight.poses[:steps], flight.time_s[:steps], flight.returns[:steps])


def test_the_map_contains_the_river_with_water_along_its_course(easy_world: World):
    river_map = RiverMap(easy_world)
    image = np.asarray(river_map.image).astype(int)
    pixels = np.array([river_map.pixel(x, y) for x, y in easy_world.river.position_m])
    assert pixels.min() > 0
    assert pixels.max() < LARGE.map_px
    red, _, blue = np.median(image[pixels[:, 1].astype(int), pixels[:, 0].astype(int)], axis=0)
    assert blue > red  # the course lies on water; the forest around it has more red and green than blue
    assert np.median(image[..., 2]) < np.median(image[..., 1])


def test_north_is_up_and_east_is_right_on_the_map(easy_world: World):
    river_map = RiverMap(easy_world)
    x, y = easy_world.river.position_m[0]
    column, row = river_map.pixel(x, y)
    assert river_map.pixel(x + 10, y)[0] > column
    assert river_map.pixel(x, y + 10)[1] < row


def test_a_map_around_a_point_has_it_in_the_middle_and_the_end_of_the_track_on_it(easy_world: World):
    x, y = easy_world.river.position_m[5]
    river_map = RiverMap(easy_world, 100, np.array([x, y]))
    assert river_map.pixel(x, y) == pytest.approx((50, 50))
    assert river_map.pixel(x + AROUND_M, y - AROUND_M) == pytest.approx((100, 100))
    track = np.array([[x - 5.0, y, 4.0, 0.0], [x, y, 4.0, 0.0]])
    drawn = np.asarray(river_map.with_track(track))
    assert tuple(drawn[50, 50]) == VEHICLE and tuple(drawn[50, 40]) == START


def test_a_smooth_track_keeps_its_ends_and_loses_its_zigzag():
    straight = np.array([[float(step), 0.5 * (-1) ** step] for step in range(40)])
    track = smooth(straight)
    np.testing.assert_array_equal(track[[0, -1]], straight[[0, -1]])
    np.testing.assert_allclose(track[1], straight[:3].mean(axis=0))
    np.testing.assert_allclose(track[20], straight[16:25].mean(axis=0))
    assert np.abs(track[10:30, 1]).max() < 0.06 and np.allclose(track[:, 0], straight[:, 0])
    np.testing.assert_array_equal(smooth(straight[:1]), straight[:1])


def picture_with(mask: np.ndarray, shape: FilmFormat) -> np.ndarray:
    """Return a black picture of a film with a mask, which fills its inset."""
    picture = np.zeros((*shape.size_px[::-1], 3), np.uint8)
    left, top, right, bottom = inset_box(shape)
    picture[top:bottom, left:right] = np.asarray(Image.fromarray(mask).resize((right - left, bottom - top)))[..., None]
    return picture


def test_the_picture_of_a_film_has_the_river_ahead_and_banks_at_its_sides():
    bank, lake, river, side = (np.zeros((30, 30), np.uint8) for _ in range(4))
    lake[15:], river[15:, 10:20], side[15:, :10] = 255, 255, 255
    scores = [shows_river(picture_with(mask, SMALL), SMALL) for mask in (river, lake, bank, side)]
    assert scores[0] > 0.4 and scores[1:3] == pytest.approx([0, 0], abs=0.02) and scores[3] < -0.1


WIDE, TALL = format_of(Camera(400, 700)), format_of(Camera(96, 64))


@pytest.mark.parametrize("shape", [LARGE, SMALL, WIDE, TALL])
def test_the_text_is_above_the_map_and_the_mask_in_the_sky_where_no_controls_cover_them(shape: FilmFormat):
    _, height = shape.size_px
    assert shape.map_top_px + shape.map_px == MARGIN_PX + shape.view_px <= height - MARGIN_PX
    assert shape.map_top_px >= 4 * shape.font_px  # four lines
    assert inset_box(shape)[3] < height / 2


def test_frames_are_shown_as_they_are_and_those_that_are_lower_are_enlarged():
    assert format_of(Camera(384, 384)) == replace(LARGE, view_width_px=384)
    assert (WIDE.view_size_px, WIDE.size_px) == ((700, 400), (1056, 432))
    assert (TALL.view_size_px, TALL.inset_size_px) == ((256, 384), (75, 112))
    assert all(side % BLOCK_PX == 0 for shape in (LARGE, SMALL, WIDE, TALL) for side in shape.size_px)
    with pytest.raises(ResultsError, match=r"at most 4 times the other, not 401 x 100 pixels \(height x width\)"):
        format_of(Camera(401, 100))
    assert format_of(Camera(400, 100)).view_size_px == (100, 400)


def test_a_wide_frame_fills_its_view_to_the_pixel(easy_world: World):
    flight = flight_on(easy_world, steps=1)
    frame = np.random.default_rng(0).integers(256, size=(400, 700, 4), dtype=np.uint8)
    (shown,) = film.film_frames(easy_world, flight, "pilot", WIDE, draw=lambda _: frame)
    assert shown.shape == (432, 1056, 3)
    left, top, right, bottom = inset_box(WIDE)
    view = shown[MARGIN_PX : MARGIN_PX + 400, MARGIN_PX : MARGIN_PX + 700]
    np.testing.assert_array_equal(view[bottom:], frame[bottom:, :, :3])
    mask = np.asarray(Image.fromarray(frame[..., 3]).resize((right - left, bottom - top)))
    np.testing.assert_array_equal(shown[top:bottom, left:right, 0], mask)
    assert (right - left) / (bottom - top) == pytest.approx(700 / 400, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "shown"), [(LARGE, 7), (SMALL, 3)])
def test_a_film_has_a_frame_for_each_shown_step_and_holds_the_last(
    easy_world: World, tmp_path: Path, shape: FilmFormat, shown: int
):
    path = tmp_path / "film.mp4"
    drawn: list[None] = []
    flight = flight_on(easy_world, steps=7)
    write_film(
        path, easy_world, flight, "pilot", shape=shape, camera=Camera(32, 32), on_frame=lambda: drawn.append(None)
    )
    about: Any = next(imageio_ffmpeg.read_frames(str(path)))
    assert comment_of(path) == FILM_COMMENT
    frames = list(read_video(path))
    assert (len(drawn), len(frames)) == (shown, shown + round(HOLD_S * FRAMES_PER_S))
    assert about["codec"] == "h264"
    assert frames[0].shape == (shape.size_px[1], shape.size_px[0], 3)
    assert np.abs(frames[shown - 1].astype(int) - frames[-1]).mean() < 2
    assert np.abs(frames[0].astype(int) - frames[-1]).mean() > 2
    assert sorted(file.name for file in tmp_path.iterdir()) == ["film.jpg", "film.mp4"]


@pytest.mark.parametrize(("steps", "shown"), [(1, [0]), (3, [0, 2]), (4, [0, 3]), (8, [0, 3, 6, 7])])
def test_the_last_step_is_always_shown(steps: int, shown: list[int]):
    assert SMALL.shown_steps(steps) == shown
    assert LARGE.shown_steps(steps) == list(range(steps))


def test_sides_that_are_no_multiple_of_a_block_grow_to_one():
    shape = replace(SMALL, map_px=168)
    assert (shape.view_px + 168 + 3 * MARGIN_PX, shape.size_px) == (440, (448, 256))


def test_a_flight_without_steps_is_refused(easy_world: World, tmp_path: Path):
    flight = flight_on(easy_world, steps=0)
    with pytest.raises(ResultsError, match="without a step"):
        write_film(tmp_path / "film.mp4", easy_world, flight, "pilot")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("ahead", "during", "end"),
    [(None, "return 0.50 of 10", "return 1.25 of 10"), (0.5, "return 0.50", "return 1.25, 50% of the course ahead")],
)
def test_returns_of_open_courses_are_not_compared_with_ten(
    easy_world: World, ahead: float | None, during: str, end: str
):
    flight = flight_on(easy_world, 3)
    flight = replace(
        flight, returns=np.array([0.0, 0.5, 1.0]), episode=replace(flight.episode, ahead=ahead, return_=1.25)
    )
    assert [film._caption(easy_world, flight, index)[1] for index in (1, 2)] == [during, end]


def test_the_poster_is_the_picture_that_shows_the_river_best(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    masks = np.zeros((3, 30, 30), np.uint8)
    masks[1, :, 10:20] = 255
    pictures = [picture_with(mask, SMALL) for mask in masks]
    monkeypatch.setattr(film, "film_frames", lambda *_: iter(pictures))
    flight: Any = SimpleNamespace(poses=np.zeros((3, 4)))
    film.write_film(tmp_path / "film.mp4", ring(), flight, "pilot", shape=SMALL)
    with Image.open(tmp_path / "film.jpg") as poster:
        assert film.shows_river(np.asarray(poster), SMALL) > 0.5


def test_a_film_shows_what_moved_and_the_wind_of_each_step(monkeypatch: pytest.MonkeyPatch):
    drawn: list[Any] = []

    class Draws:
        def __init__(self, *_: Any) -> None: ...

        def render(self, *_: Any, **given: Any) -> np.ndarray:
            drawn.append({name: values.tolist() for name, values in given.items()})
            return np.zeros((1, 2, 2, 4), np.uint8)

    monkeypatch.setattr(film, "Renderer", Draws)
    props, wind = np.arange(12, dtype=np.float32).reshape(2, 1, 6), np.array([[1.0, 2.0], [3.0, 4.0]])
    flight: Any = SimpleNamespace(poses=np.zeros((2, 4)), time_s=np.zeros(2), props=props, wind=wind)
    film.drawn_by(ring(), flight, Camera(16, 16))(1)
    assert drawn == [{"props": props[1:].tolist(), "wind": [[3.0, 4.0]]}]
