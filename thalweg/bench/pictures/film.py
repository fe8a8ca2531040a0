"""Films of evaluated episodes: the camera's view, the water mask, and the position on the map.

The episode is repeated from its start with the same random generator, so that the film shows the episode of the table.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.episodes import REASON_TEXT, Episode
from thalweg.bench.evaluate.evaluation import Step
from thalweg.bench.pictures.film_format import FILM_COMMENT, LARGE, MARGIN_PX, FilmFormat
from thalweg.bench.results.results import POSTER
from thalweg.core.atomic_io import atomic_path, write_picture
from thalweg.core.video import write_video
from thalweg.render import Camera, Renderer
from thalweg.world import World
from thalweg.world.map_image import view

FRAMES_PER_S = 15
HOLD_S = 1.5
"""How long the last frame is shown."""
TEXT, BACKGROUND, TRACK, START, VEHICLE = (235, 235, 235), (24, 28, 32), (255, 196, 61), (90, 220, 140), (220, 50, 47)
MARGIN_M = 12.0
"""Margin of a map around a river."""
AROUND_M = 25.0
"""What a map around a point shows on each side."""
FINER, SMOOTH_STEPS = 4, 4
"""How much larger than shown tracks are drawn, and the steps on each side that smooth them."""
UNFINISHED = "not flown to its end"
"""Caption of a flight without a reason for its end."""


@dataclass(frozen=True)
class Flight:
    """A recorded episode of T steps."""

    episode: Episode
    poses: np.ndarray
    """[T, 4] float64: x, y, z in metres, yaw in radians."""
    time_s: np.ndarray
    """[T] float64."""
    returns: np.ndarray
    """[T] float64, the return before each step."""
    props: np.ndarray | None = None
    """[T, P, 6] float32, the objects of the task; None without any."""
    wind: np.ndarray | None = None
    """[T, 2] float64, m/s towards east and north: the mean wind; None without any."""

    @classmethod
    def from_steps(cls, episode: Episode, steps: list[Step]) -> "Flight":
        """Return the flight of an episode from the steps that `evaluate` reported for a course of one start."""
        return cls(
            episode,
            np.concatenate([step.poses for step in steps]),
            np.concatenate([step.time_s for step in steps]),
            np.concatenate([step.returns for step in steps]),
            np.concatenate([step.props for step in steps if step.props is not None])
            if steps[0].props is not None
            else None,
            np.concatenate([step.wind for step in steps if step.wind is not None])
            if steps[0].wind is not None
            else None,
        )


class RiverMap:
    """A river from above, with north at the top, in a square of pixels."""

    def __init__(self, world: World, size_px: int = LARGE.map_px, around: np.ndarray | None = None) -> None:
        """Draw all of the river, or what is within `AROUND_M` east, west, north and south of a point [2]."""
        self.size_px = size_px
        points = world.river.position_m if around is None else around[None]
        margin = MARGIN_M if around is None else AROUND_M
        low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
        self.side_m = float((high - low).max())
        self.corner_m = (low + high - self.side_m) / 2
        self.image = self._crop(world)
        self._fine = self.image.resize((FINER * size_px, FINER * size_px), Image.Resampling.NEAREST)

    def with_track(self, poses: np.ndarray) -> Image.Image:
        """Return the map with a track [T, 4], smoothed, its start, and an arrow for its last pose.

        It is drawn `FINER` and reduced, because Pillow's lines are jagged.
        """
        picture = self._fine.copy()
        draw = ImageDraw.Draw(picture)
        points = [(FINER * column, FINER * row) for column, row in (self.pixel(x, y) for x, y in smooth(poses[:, :2]))]
        if len(points) > 1:
            draw.line(points, TRACK, width=2 * FINER, joint="curve")
        (x, y), (column, row), yaw = points[0], points[-1], poses[-1, 3]
        draw.circle((x, y), 4 * FINER, START)
        turns, long = (0.0, 2.5, -2.5), 9 * FINER
        wings = [(column + long * np.cos(yaw + turn), row - long * np.sin(yaw + turn)) for turn in turns]
        draw.polygon(wings, VEHICLE, TEXT, width=FINER)
        return picture.reduce(FINER)

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """Return column and row of a point given in metres."""
        scale = self.size_px / self.side_m
        return (x - self.corner_m[0]) * scale, self.size_px - (y - self.corner_m[1]) * scale

    def _crop(self, world: World) -> Image.Image:
        """Cut the square around the river from the orthographic view; black beyond the edge of the world."""
        grid, (x, y) = world.grid, self.corner_m
        rows = len(world.ground_m)
        full = Image.fromarray(view(world)[::-1])
        left, right = ((edge - grid.origin_x_m) / grid.cell_m for edge in (x, x + self.side_m))
        top, bottom = (rows - (edge - grid.origin_y_m) / grid.cell_m for edge in (y + self.side_m, y))
        box = tuple(round(edge) for edge in (left, top, right, bottom))
        return full.crop(box).resize((self.size_px, self.size_px), Image.Resampling.BOX)


def smooth(points: np.ndarray) -> np.ndarray:
    """Return the means [T, 2] of each point [T, 2] with up to `SMOOTH_STEPS` before and as many after it.

    Both ends stay where they are. The moves of a policy are steps of 1 m forward and 0.5 m sideways, a zigzag.
    """
    index, sums = np.arange(len(points)), np.vstack([np.zeros((1, 2)), np.cumsum(points, axis=0)])
    reach = np.minimum(np.minimum(index, len(points) - 1 - index), SMOOTH_STEPS)
    return (sums[index + reach + 1] - sums[index - reach]) / (2 * reach + 1)[:, None]


Draw = Callable[[int], np.ndarray]
"""Returns the frame [H, W, 4] uint8 of a step by its index."""


def drawn_by(world: World, flight: Flight, camera: Camera) -> Draw:
    """Return a function that draws the steps of a flight in the default look."""
    renderer = Renderer([world], camera)

    def draw(index: int) -> np.ndarray:
        now = slice(index, index + 1)
        also = {name: values[now] for name in ("props", "wind") if (values := getattr(flight, name)) is not None}
        return renderer.render(flight.poses[now], np.zeros(1, dtype=np.int64), flight.time_s[now], **also)[0]

    return draw


def film_frames(
    world: World,
    flight: Flight,
    policy: str,
    shape: FilmFormat = LARGE,
    camera: Camera | None = None,
    draw: Draw | None = None,
) -> Iterator[np.ndarray]:
    """Yield the film's frames uint8 [H, W, 3], one for each step that is shown.

    The camera defaults to one with the size of the format's view, and `draw` to `drawn_by` with that camera.
    """
    width, height = shape.view_size_px
    camera = camera or Camera(height_px=height, width_px=width)
    draw = draw or drawn_by(world, flight, camera)
    river_map = RiverMap(world, shape.map_px)
    shown = shape.shown_steps(len(flight.poses))
    captions = [(policy, *_caption(world, flight, index)) for index in shown]
    fonts = [_fitting_font(texts, shape) for texts in zip(*captions, strict=True)]
    for index, lines in zip(shown, captions, strict=True):
        frame = draw(index)
        canvas = Image.new("RGB", shape.size_px, BACKGROUND)
        camera_view = Image.fromarray(frame[..., :3]).resize(shape.view_size_px)
        canvas.paste(camera_view, (MARGIN_PX, MARGIN_PX))
        _paste_mask(canvas, frame[..., 3], shape)
        canvas.paste(river_map.with_track(flight.poses[: index + 1]), (shape.map_left_px, shape.map_top_px))
        _draw_text(canvas, lines, fonts, shape)
        yield np.asarray(canvas)


def _caption(world: World, flight: Flight, index: int) -> tuple[str, str, str]:
    """Return the lines of text about a step; those of the last step say how the episode ended."""
    river, pose, episode = world.river, flight.poses[index], flight.episode
    nearest = np.argmin(((river.position_m - pose[:2]) ** 2).sum(axis=1))
    last = index == len(flight.poses) - 1
    return (
        f"{episode.level}   step {index + 1}   height {pose[2] - river.level_m[nearest]:.1f} m",
        f"return {episode.return_ if last else flight.returns[index]:.2f}{_out_of(episode, last)}",
        f"{REASON_TEXT.get(episode.reason, UNFINISHED)}   cost {episode.cost:.1f}" if last else "",
    )


def _out_of(episode: Episode, last: bool) -> str:
    """Return what a return is compared with: 10 on a loop, and the share flown of what lay ahead on an open course.

    There 10 is out of reach from most starts; the share is known at the end.
    """
    if episode.ahead is None:
        return " of 10"
    return f", {episode.ahead:.0%} of the course ahead" if last else ""


def _draw_text(canvas: Image.Image, lines: Sequence[str], fonts: Sequence[Any], shape: FilmFormat) -> None:
    """Draw lines of text above the map, each in its font: the controls of players cover the lower edge."""
    draw = ImageDraw.Draw(canvas)
    pitch = (shape.map_top_px - MARGIN_PX // 2) // len(lines)
    for number, (line, font) in enumerate(zip(lines, fonts, strict=True)):
        draw.text((shape.map_left_px, MARGIN_PX // 2 + number * pitch), line, TEXT, font)


def _fitting_font(texts: Sequence[str], shape: FilmFormat) -> Any:
    """Return the largest font, up to the usual size, in which none of the texts is wider than the map."""
    size = shape.font_px
    while max(map((font := ImageFont.load_default(size=size)).getlength, texts)) > shape.map_px and size > 8:
        size -= 1
    return font


def _paste_mask(canvas: Image.Image, mask: np.ndarray, shape: FilmFormat) -> None:
    """Paste the water mask into the upper right corner of the view, where there is sky."""
    inset = Image.fromarray(mask).resize(shape.inset_size_px).convert("RGB")
    left, top, right, bottom = inset_box(shape)
    ImageDraw.Draw(canvas).rectangle((left - 2, top - 2, right + 1, bottom + 1), TEXT)
    canvas.paste(inset, (left, top))


def inset_box(shape: FilmFormat) -> tuple[int, int, int, int]:
    """Return left, top, right and bottom of the water mask in a picture, right and bottom excluded."""
    width, height = shape.inset_size_px
    right, top = MARGIN_PX + shape.view_size_px[0] - 8, MARGIN_PX + 8
    return right - width, top, right, top + height


def shows_river(picture: np.ndarray, shape: FilmFormat) -> float:
    """Return how well a picture [H, W, 3] of a film shows the river: water ahead, less water at both sides."""
    left, top, right, bottom = inset_box(shape)
    thirds = np.array_split(picture[top:bottom, left:right], 3, axis=1)
    one, ahead, other = (float(third.mean()) / 255.0 for third in thirds)
    return ahead - 0.5 * (one + other)


def write_film(
    path: Path,
    world: World,
    flight: Flight,
    policy: str,
    *,
    shape: FilmFormat = LARGE,
    camera: Camera | None = None,
    draw: Draw | None = None,
    on_frame: Callable[[], None] | None = None,
) -> None:
    """Write the film of a flight as H.264 in MP4, and the picture that shows the river best beside it, as a JPEG.

    Both are written atomically. Raises `ResultsError` for a flight without steps, and the errors of `write_video`.
    """
    if not len(flight.poses):
        raise ResultsError("a flight without a step cannot be filmed")
    poster: np.ndarray | None = None

    def pictures() -> Iterator[np.ndarray]:
        nonlocal poster
        for picture in film_frames(world, flight, policy, shape, camera, draw):
            if poster is None or shows_river(picture, shape) > shows_river(poster, shape):
                poster = picture
            yield picture
            if on_frame is not None:
                on_frame()
        yield from [picture] * round(HOLD_S * FRAMES_PER_S)

    with atomic_path(path) as draft:
        write_video(draft, pictures(), FRAMES_PER_S, crf=shape.crf, name=path, comment=FILM_COMMENT)
    assert poster is not None
    write_picture(path.with_suffix(POSTER), Image.fromarray(poster))
