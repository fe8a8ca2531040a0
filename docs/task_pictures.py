"""Pictures of the tasks where safety has a price: `python docs/task_pictures.py` draws them in about a minute.

For each task, the map of Medium's fixed river shows two flights of the oracle from the same start, one to which costs
are worth nothing and one to which they are worth a lot; beside it is what the camera of the first sees at two places.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import start_env
from thalweg.bench.fronts.flights import PRICES
from thalweg.bench.pictures.film import RiverMap, smooth
from thalweg.bench.suite.priced import LIMITS
from thalweg.core.atomic_io import atomic_path
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.oracle.oracle import Oracle
from thalweg.env.spaces import from_unit_actions
from thalweg.env.tasks import TASKS, TaskName
from thalweg.render import Camera, Renderer
from thalweg.world import load_or_build

IMAGES = Path(__file__).resolve().parent / "images"
LEVEL, START = "Medium", 4
"""Level, and index of the start in its list, of all flights."""
SIZE_PX, GAP_PX, FINER, LINE_PX, TEXT_PX = 384, 6, 3, 2, 15
FAST, CAREFUL, COSTLY, RESERVE = (255, 179, 71), (125, 220, 255), (255, 40, 60), (190, 110, 255)
"""Colours of the flights without and with a price, of steps that cost something, and of reserves."""
PAPER = (255, 255, 255)
NEAR_M, ASIDE = (6.0, 16.0), 0.25
"""Distances of the objects that the frames show, and how far beside the middle they are, as a share of it."""


@dataclass(frozen=True)
class Flown:
    """A flight of T steps at a price."""

    poses: np.ndarray
    """[T, 4] x, y, z in metres and the heading in radians, before each step."""
    costs: np.ndarray
    """[T] cost of each step, without that of an ending."""
    props: np.ndarray | None
    """[T, P, 6] objects about the vehicle, as `thalweg.render.records.props`."""
    return_: float

    @property
    def label(self) -> str:
        """Return and cost of the flight."""
        return f"return {self.return_:.1f}, cost {self.costs.sum():.0f}"


def main() -> None:
    for name in LIMITS:
        with atomic_path(IMAGES / f"task-{name.lower()}.jpg") as draft:
            picture(name).save(draft, format="JPEG", quality=88)
        print(f"docs/images/task-{name.lower()}.jpg")


def picture(task: TaskName) -> Image.Image:
    """Return the map with both flights and two frames of the first, side by side."""
    config = EvaluationConfig(START + 1, env=EnvConfig(observation="none", task=task))
    course = Course.on(load_or_build(LEVEL), config).only(START)
    env = start_env(course, config)
    fast, careful = flown(course, config, PRICES[0]), flown(course, config, PRICES[-1])
    tiles = [map_of(env, fast, careful), *frames(env, fast)]
    board = Image.new("RGB", (len(tiles) * (SIZE_PX + GAP_PX) - GAP_PX, SIZE_PX), PAPER)
    for index, tile in enumerate(tiles):
        board.paste(tile, (index * (SIZE_PX + GAP_PX), 0))
    return board


def flown(course: Course, config: EvaluationConfig, price: float) -> Flown:
    """Return the oracle's flight from a course's only start."""
    env = start_env(course, config)
    oracle = Oracle(env.courses, config.env, price)
    plan, ahead = oracle.plan(env.state)
    kind = env.cost_kinds.index(TASKS[config.env.task].kind)
    poses, costs, props, total, ended = [], [], [], 0.0, False
    while not ended:
        props.append(env.props())
        poses.append(env.state.pose[0].copy())
        unit_actions = oracle.actions(plan, env.state, ahead, np.ones(1, bool))
        actions = from_unit_actions(env.config.action, unit_actions, env.config.fast_ratio)
        _, reward, terminated, truncated, info = env.step(actions)
        costs.append(float(info["costs"][0, kind]))
        total, ended = total + float(reward[0]), bool(terminated[0] or truncated[0])
    env.close()
    return Flown(np.array(poses), np.array(costs), None if props[0] is None else np.concatenate(props), total)


def map_of(env: RiverVectorEnv, fast: Flown, careful: Flown) -> Image.Image:
    """Return the map with reserves, both tracks and, in their own colour, the steps that cost something."""
    river = RiverMap(env.worlds[0], SIZE_PX)
    drawn = river.image.resize((FINER * SIZE_PX, FINER * SIZE_PX), Image.Resampling.BICUBIC)
    draw = ImageDraw.Draw(drawn)

    def line(points: np.ndarray, colour: tuple[int, int, int], width: float) -> None:
        pixels = [(FINER * column, FINER * row) for column, row in (river.pixel(x, y) for x, y in points)]
        draw.line(pixels, colour, width=round(FINER * width), joint="curve")

    for reserve in env.courses.reserve:
        inside = (env.worlds[0].river.arc_m >= reserve[0]) & (env.worlds[0].river.arc_m <= reserve[1])
        line(env.worlds[0].river.position_m[inside], RESERVE, 5 * LINE_PX)
    for flight, colour in ((fast, FAST), (careful, CAREFUL)):
        track = smooth(flight.poses[:, :2])
        line(track, colour, LINE_PX)
        for step in np.flatnonzero(flight.costs > 0):
            line(track[step : step + 2], COSTLY, LINE_PX)
    picture = drawn.reduce(FINER)
    write(picture, [("no price: " + fast.label, FAST), (f"price {PRICES[-1]:g}: " + careful.label, CAREFUL)])
    return picture


def write(picture: Image.Image, lines: Sequence[tuple[str, tuple[int, int, int]]]) -> None:
    """Write lines of text at the lower edge, with a dark border."""
    draw, font = ImageDraw.Draw(picture), ImageFont.load_default(size=TEXT_PX)
    for number, (text, colour) in enumerate(reversed(lines)):
        at = (GAP_PX, picture.height - (number + 1) * (TEXT_PX + 3) - 3)
        draw.text(at, text, colour, font, stroke_width=2, stroke_fill=(20, 24, 28))


def frames(env: RiverVectorEnv, flight: Flown) -> list[Image.Image]:
    """Return what the camera sees at two steps of a flight."""
    renderer = Renderer([env.worlds[0]], Camera(SIZE_PX, SIZE_PX))
    chosen = steps(flight)
    props = None if flight.props is None else flight.props[chosen]
    views = renderer.render(flight.poses[chosen], time_s=2.0, props=props)
    return [Image.fromarray(np.ascontiguousarray(view[..., :3])) for view in views]


def steps(flight: Flown) -> np.ndarray:
    """Return two steps, one of each half of the flight: those with an object before the camera, else costly ones.

    Among equal ones the first of each half is chosen.
    """
    worth = (flight.costs > 0).astype(float)
    if flight.props is not None:
        away = flight.props[..., 1:3] - flight.poses[:, None, :2]
        yaw = flight.poses[:, 3][:, None]
        ahead = away[..., 0] * np.cos(yaw) + away[..., 1] * np.sin(yaw)
        aside = away[..., 1] * np.cos(yaw) - away[..., 0] * np.sin(yaw)
        seen = (flight.props[..., 0] > 0) & (ahead > NEAR_M[0]) & (ahead < NEAR_M[1]) & (np.abs(aside) < ASIDE * ahead)
        worth += np.where(seen, 1.0 + 1.0 / np.maximum(ahead, NEAR_M[0]), 0.0).max(axis=1)
    half = len(worth) // 2
    return np.array([worth[:half].argmax(), half + worth[half:].argmax()])


if __name__ == "__main__":
    main()
