"""What does a flight look like? A film of one evaluated episode: the view, the water mask, and where it is on the map.

The flight is flown again from its start with the generator it had: the film shows the very episode of the table.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.episodes import WORDS, Episode
from thalweg.bench.evaluate.evaluation import Step
from thalweg.bench.pictures.film_format import LARGE, MARGIN_PX, Format
from thalweg.core.atomic_io import atomic_path
from thalweg.render import Camera, Renderer
from thalweg.world import World
from thalweg.world.map_image import view

FRAMES_PER_S = 15
HOLD_S = 1.5
"""How long the last picture stays."""
INK, PAPER, ACCENT, START = (235, 235, 235), (24, 28, 32), (255, 196, 61), (90, 220, 140)


@dataclass(frozen=True)
class Flight:
    """A flight to be filmed; T steps."""

    episode: Episode
    poses: np.ndarray
    """[T, 4] float64."""
    time_s: np.ndarray
    """[T] float64."""
    returns: np.ndarray
    """[T] float64, the return before each step."""

    @classmethod
    def of(cls, episode: Episode, steps: list[Step]) -> "Flight":
        """A flight from what `evaluate` told while it flew a course of one start."""
        return cls(
            episode,
            np.concatenate([step.poses for step in steps]),
            np.concatenate([step.time_s for step in steps]),
            np.concatenate([step.returns for step in steps]),
        )


class Map:
    """The river from above, with north at the top, in a square of pixels."""

    def __init__(self, world: World, size_px: int = LARGE.map_px, margin_m: float = 12.0) -> None:
        self.size_px = size_px
        low, high = world.river.position_m.min(axis=0) - margin_m, world.river.position_m.max(axis=0) + margin_m
        self.side_m = float((high - low).max())
        self.corner_m = (low + high - self.side_m) / 2
        self.picture = self._crop(world)

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """Column and row of a place in metres."""
        scale = self.size_px / self.side_m
        return (x - self.corner_m[0]) * scale, self.size_px - (y - self.corner_m[1]) * scale

    def _crop(self, world: World) -> Image.Image:
        """The square around the river out of the orthographic view; black where the map ends."""
        grid, (x, y) = world.grid, self.corner_m
        rows = len(world.ground_m)
        whole = Image.fromarray(view(world)[::-1])
        left, right = ((edge - grid.origin_x_m) / grid.cell_m for edge in (x, x + self.side_m))
        top, bottom = (rows - (edge - grid.origin_y_m) / grid.cell_m for edge in (y + self.side_m, y))
        box = tuple(round(edge) for edge in (left, top, right, bottom))
        return whole.crop(box).resize((self.size_px, self.size_px), Image.Resampling.BOX)


def pictures(
    world: World, flight: Flight, policy: str, shape: Format = LARGE, camera: Camera | None = None
) -> Iterator[np.ndarray]:
    """The film's frames uint8 [H, W, 3], of each step that is shown; the view is the camera's, one of the format's
    size if not given."""
    renderer = Renderer([world], camera or Camera(height_px=shape.view_px, width_px=shape.view_px))
    chart = Map(world, shape.map_px)
    shown = shape.shown(len(flight.poses))
    said = [(policy, *_said(world, flight, index)) for index in shown]
    fonts = [_fitting(texts, shape) for texts in zip(*said, strict=True)]
    for index, lines in zip(shown, said, strict=True):
        now = slice(index, index + 1)
        frame = renderer.render(flight.poses[now], np.zeros(1, dtype=np.int64), flight.time_s[now])[0]
        canvas = Image.new("RGB", shape.size_px, PAPER)
        seen = Image.fromarray(frame[..., :3]).resize((shape.view_px, shape.view_px))
        canvas.paste(seen, (MARGIN_PX, MARGIN_PX))
        _paste_mask(canvas, frame[..., 3], shape)
        canvas.paste(_with_track(chart, flight.poses[: index + 1]), (shape.beside_px, MARGIN_PX))
        _write(canvas, lines, fonts, shape)
        yield np.asarray(canvas)


def _said(world: World, flight: Flight, index: int) -> tuple[str, str, str]:
    """What is said of a step; of the last also how it ended."""
    river, pose, episode = world.river, flight.poses[index], flight.episode
    nearest = np.argmin(((river.position_m - pose[:2]) ** 2).sum(axis=1))
    last = index == len(flight.poses) - 1
    return (
        f"{episode.level}   step {index + 1}   height {pose[2] - river.level_m[nearest]:.1f} m",
        f"return {episode.return_ if last else flight.returns[index]:.2f} of 10",
        f"{WORDS[episode.reason]}   cost {episode.cost:.1f}" if last else "",
    )


def _write(canvas: Image.Image, lines: Sequence[str], fonts: Sequence[Any], shape: Format) -> None:
    """Lines of text below the map, each in its font."""
    draw = ImageDraw.Draw(canvas)
    below = MARGIN_PX + shape.map_px + 6
    pitch = (shape.size_px[1] - below - 4) // len(lines)
    for number, (line, font) in enumerate(zip(lines, fonts, strict=True)):
        draw.text((shape.beside_px, below + number * pitch), line, INK, font)


def _fitting(texts: Sequence[str], shape: Format) -> Any:
    """The font in which none of the texts is wider than the map above them: of the usual size, or as much smaller as it
    takes."""
    size = shape.font_px
    while max(map((font := ImageFont.load_default(size=size)).getlength, texts)) > shape.map_px and size > 8:
        size -= 1
    return font


def _paste_mask(canvas: Image.Image, mask: np.ndarray, shape: Format) -> None:
    side = shape.inset_px
    inset = Image.fromarray(mask).resize((side, side)).convert("RGB")
    corner = MARGIN_PX + shape.view_px - side - 8
    ImageDraw.Draw(canvas).rectangle((corner - 2, corner - 2, corner + side + 1, corner + side + 1), INK)
    canvas.paste(inset, (corner, corner))


def _with_track(chart: Map, poses: np.ndarray) -> Image.Image:
    picture = chart.picture.copy()
    draw = ImageDraw.Draw(picture)
    points = [chart.pixel(x, y) for x, y in poses[:, :2]]
    if len(points) > 1:
        draw.line(points, ACCENT, width=2)
    (x, y), (column, row), yaw = points[0], points[-1], poses[-1, 3]
    draw.ellipse((x - 4, y - 4, x + 4, y + 4), START)
    wings = [(column + 9 * np.cos(yaw + turn), row - 9 * np.sin(yaw + turn)) for turn in (0.0, 2.5, -2.5)]
    draw.polygon(wings, (220, 50, 47), INK)
    return picture


def write_film(
    path: Path,
    world: World,
    flight: Flight,
    policy: str,
    *,
    shape: Format = LARGE,
    camera: Camera | None = None,
    on_frame: Callable[[], None] | None = None,
) -> None:
    """Write the film of a flight as H.264 in MP4, whole or not at all; raises `ResultsError` for one of no step."""
    if not len(flight.poses):
        raise ResultsError("a flight without a step cannot be filmed")
    options = ["-crf", str(shape.crf), "-preset", "medium", "-movflags", "+faststart"]
    settings = {"fps": FRAMES_PER_S, "codec": "libx264", "pixelformat": "yuv420p", "quality": None}
    with atomic_path(path) as draft, imageio.get_writer(draft, output_params=options, **settings) as writer:
        for picture in pictures(world, flight, policy, shape, camera):
            writer.append_data(picture)  # pyright: ignore[reportAttributeAccessIssue]
            if on_frame is not None:
                on_frame()
        for _ in range(round(HOLD_S * FRAMES_PER_S)):
            writer.append_data(picture)  # pyright: ignore
