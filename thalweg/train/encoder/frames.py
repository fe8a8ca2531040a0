"""Frames for encoders: views from random safe poses in the rivers of a level, as after resets.

Frame i depends on the seed, i and the number of rivers alone, so that a larger collection starts with a smaller one.
"""

from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from thalweg.core.seeds import parse_seeds
from thalweg.encoder import EncoderInputError
from thalweg.env import sample_starts
from thalweg.env.frame_renderer import lights_per_world, relit_worlds
from thalweg.env.initial_poses import CLOCK_RANGE_S
from thalweg.render import Camera, Renderer
from thalweg.render.records.quality import Quality
from thalweg.render.records.randomisation import Randomisation
from thalweg.world import Reach, World, load_or_build
from thalweg.world.levels import level_named

BATCH = 16
"""Frames rendered by one call."""
TOGETHER = 16
"""Greatest number of rivers in memory at a time."""


def collect_frames(
    count: int = 2000,
    level: str | Reach = "Medium",
    seed: int = 0,
    *,
    rivers: int = 1,
    world_seeds: Any = (),
    camera: Camera | None = None,
    quality: Quality = "full",
    randomisation: Randomisation | None = None,
    progress: bool = True,
) -> np.ndarray:
    """Return frames uint8 [count, H, W, 4], colour and water mask 0/255, of random initial poses in rivers of a level.

    The rivers have the seeds `world_seeds`, see `thalweg.core.seeds`. Without any, the first is the level's fixed one,
    and others have the seeds that follow. Of a real river, a `Reach`, seeds change plants and hills; the first is 0.
    Frame i is of river i % their number. With a `randomisation`, each has a look of its own and one of the suns of its
    river. Raises `WorldError` for an unknown level and `EncoderInputError` for counts out of range and seeds that
    cannot be read.
    """
    first = 0 if isinstance(level, Reach) else level_named(level).default_seed
    seeds = parse_seeds(world_seeds, "world_seeds", EncoderInputError) or tuple(range(first, first + rivers))
    if count < 1 or not 1 <= len(seeds) <= count:
        raise EncoderInputError(
            f"{count} images of {len(seeds)} rivers: there must be at least one river and one image of each"
        )
    camera = camera or Camera()
    frames = np.empty((count, camera.height_px, camera.width_px, 4), np.uint8)
    river, clock = np.arange(count) % len(seeds), clock_times(count, seed)
    looks, suns = drawn_looks(count, seed, randomisation)
    for group in range(0, len(seeds), TOGETHER):
        worlds = [_world(level, each) for each in seeds[group : group + TOGETHER]]
        rows = np.flatnonzero(river // TOGETHER == group // TOGETHER)
        index = river[rows] - group
        poses, lights = sample_poses(worlds, index, seed + group), lights_per_world(randomisation)
        renderer = Renderer(relit_worlds(worlds, randomisation), camera, quality)
        views = poses, index * lights + suns[rows], clock[rows]
        look = None if looks is None else looks[rows]
        drawn = render_frames(renderer, *views, look=look, progress=progress)
        if len(rows) == count:
            return drawn
        frames[rows] = drawn
    return frames


def drawn_looks(count: int, seed: int, randomisation: Randomisation | None) -> tuple[np.ndarray | None, np.ndarray]:
    """Return looks [count, P], None if they do not vary, and the index [count] of a sun of each frame's river."""
    if randomisation is None:
        return None, np.zeros(count, np.int64)
    rng = np.random.default_rng([seed, 2])
    drawn = [randomisation.draw(rng) for _ in range(count)]
    return np.array([look for look, _ in drawn]), np.array([sun for _, sun in drawn], np.int64)


def _world(level: str | Reach, seed: int) -> World:
    """Return the river of a level or a file and a seed."""
    return level.build(seed) if isinstance(level, Reach) else load_or_build(level, seed)


def level_worlds(level: str, rivers: int) -> list[World]:
    """Return the fixed river of a level, and those of the seeds that follow."""
    first = level_named(level).default_seed
    return [load_or_build(level, first + index) for index in range(rivers)]


def sample_views(worlds: list[World], count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return poses [count, 4], world index [count] and clock in seconds [count] of random resets.

    The worlds take turns.
    """
    index = np.arange(count) % len(worlds)
    return sample_poses(worlds, index, seed), index, clock_times(count, seed)


def sample_poses(worlds: list[World], index: np.ndarray, seed: int) -> np.ndarray:
    """Return poses [K, 4] of random resets in worlds of index [K]; those of world i depend on seed + i alone."""
    poses = np.empty((len(index), 4))
    for number, world in enumerate(worlds):
        poses[index == number] = sample_starts(world, int((index == number).sum()), seed + number)
    return poses


def clock_times(count: int, seed: int) -> np.ndarray:
    """Return random times [count] in seconds of the water's clock."""
    return np.random.default_rng([seed, 1]).uniform(0, CLOCK_RANGE_S, count)


def render_frames(
    renderer: Renderer,
    poses: np.ndarray,
    world_index: np.ndarray,
    time_s: np.ndarray,
    *,
    look: np.ndarray | None = None,
    progress: bool = True,
) -> np.ndarray:
    """Return frames uint8 [K, H, W, 4] of poses [K, 4], worlds [K], clock [K] and looks [K, P], with a progress bar."""
    camera = renderer.camera
    frames = np.empty((len(poses), camera.height_px, camera.width_px, 4), np.uint8)
    columns = (TextColumn("collecting frames"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), disable=not progress) as bar:
        task = bar.add_task("", total=len(poses))
        for start in range(0, len(poses), BATCH):
            rows = slice(start, start + BATCH)
            seen = None if look is None else look[rows]
            frames[rows] = renderer.render(poses[rows], world_index[rows], time_s[rows], look=seen)
            bar.update(task, advance=len(frames[rows]))
    return frames
