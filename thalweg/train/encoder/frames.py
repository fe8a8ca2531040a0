"""Frames for encoders: views from random safe poses in the rivers of a level, as after resets.

Frame i depends on the seed, i and the number of rivers alone, so that a larger collection starts with a smaller one.
"""

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from thalweg.encoder import EncoderInputError
from thalweg.env import sample_starts
from thalweg.env.initial_poses import CLOCK_RANGE_S
from thalweg.render import Camera, Renderer
from thalweg.world import World, load_or_build
from thalweg.world.levels import level_named

BATCH = 16
"""Frames rendered by one call."""


def collect_frames(
    count: int = 2000,
    level: str = "Medium",
    seed: int = 0,
    *,
    rivers: int = 1,
    camera: Camera | None = None,
    progress: bool = True,
) -> np.ndarray:
    """Return frames uint8 [count, H, W, 4], colour and water mask 0/255, of random initial poses in rivers of a level.

    The first river is the level's fixed one, the others have the seeds that follow; frame i is of river i % rivers.
    Raises `WorldError` for an unknown level and `EncoderInputError` for counts out of range.
    """
    if count < 1 or not 1 <= rivers <= count:
        raise EncoderInputError(
            f"{count} images of {rivers} rivers: there must be at least one river and one image of each"
        )
    worlds = level_worlds(level, rivers)
    return render_frames(Renderer(worlds, camera), *sample_views(worlds, count, seed), progress=progress)


def level_worlds(level: str, rivers: int) -> list[World]:
    """Return the fixed river of a level, and those of the seeds that follow."""
    first = level_named(level).default_seed
    return [load_or_build(level, first + index) for index in range(rivers)]


def sample_views(worlds: list[World], count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return poses [count, 4], world index [count] and clock in seconds [count] of random resets.

    The worlds take turns.
    """
    index = np.arange(count) % len(worlds)
    poses = np.empty((count, 4))
    for number, world in enumerate(worlds):
        poses[index == number] = sample_starts(world, int((index == number).sum()), seed + number)
    return poses, index, np.random.default_rng([seed, 1]).uniform(0, CLOCK_RANGE_S, count)


def render_frames(
    renderer: Renderer, poses: np.ndarray, world_index: np.ndarray, time_s: np.ndarray, *, progress: bool = True
) -> np.ndarray:
    """Return frames uint8 [K, H, W, 4] of poses [K, 4], worlds [K] and clock [K], with a progress bar."""
    camera = renderer.camera
    frames = np.empty((len(poses), camera.height_px, camera.width_px, 4), np.uint8)
    columns = (TextColumn("collecting frames"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, disable=not progress) as bar:
        task = bar.add_task("", total=len(poses))
        for start in range(0, len(poses), BATCH):
            rows = slice(start, start + BATCH)
            frames[rows] = renderer.render(poses[rows], world_index[rows], time_s[rows])
            bar.update(task, advance=len(frames[rows]))
    return frames
