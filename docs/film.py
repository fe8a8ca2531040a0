"""Film of the README: `python docs/film.py` draws it in about a minute.

The packaged policy flies the fixed river of Medium; the film shows the camera's view, the water mask and the map.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, Step, evaluate, observation_function
from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.bench.pictures.film import RiverMap
from thalweg.core.atomic_io import atomic_path
from thalweg.render import Camera, Renderer
from thalweg.train import load_policy
from thalweg.world import World

PATH = Path(__file__).resolve().parent / "images" / "flight.webp"
VIEW_PX, SIDE_PX, GAP_PX = 384, 188, 8
START, FIRST_STEP, EVERY, FRAMES, FRAME_MS = 3, 44, 2, 120, 80
QUALITY = 55
"""Quality of WebP; the file stays below 3 MB."""
PAPER = (24, 28, 32)


def main() -> None:
    frames = list(draw(*fly()))
    with atomic_path(PATH) as draft:
        frames[0].save(
            draft, save_all=True, append_images=frames[1:], duration=FRAME_MS, loop=0, quality=QUALITY, method=6
        )
    print(f"docs/images/{PATH.name}: {len(frames)} frames, {PATH.stat().st_size / 1e6:.2f} MB")


def fly() -> tuple[World, np.ndarray, np.ndarray]:
    """Return the world, and poses [T, 4] and times [T] of a flight of the packaged policy on Medium."""
    course = Course.of_level("Medium", EvaluationConfig()).only(START)
    steps: list[Step] = []
    policy = load_policy(PACKAGED_POLICY)
    view = observation_function(policy, course, None)
    (episode,) = evaluate(policy, course, Label("packaged", 0, "Medium"), observe=view, on_step=steps.append)
    print(f"return {episode.return_:.2f}, cost {episode.cost:.1f}, {episode.length} steps")
    return course.world, np.concatenate([step.poses for step in steps]), np.concatenate([step.time_s for step in steps])


def draw(world: World, poses: np.ndarray, times: np.ndarray) -> Iterator[Image.Image]:
    """Yield the pictures of the film, one for every second step."""
    renderer = Renderer([world], Camera(height_px=VIEW_PX, width_px=VIEW_PX))
    river_map = RiverMap(world, SIDE_PX)
    for step in range(FIRST_STEP, min(len(poses), FIRST_STEP + FRAMES * EVERY), EVERY):
        frame = renderer.render(poses[step : step + 1], time_s=times[step : step + 1])[0]
        canvas = Image.new("RGB", (VIEW_PX + GAP_PX + SIDE_PX, VIEW_PX), PAPER)
        canvas.paste(Image.fromarray(frame[..., :3]), (0, 0))
        mask = Image.fromarray(frame[..., 3]).resize((SIDE_PX, SIDE_PX))
        canvas.paste(mask.convert("RGB"), (VIEW_PX + GAP_PX, 0))
        canvas.paste(river_map.with_track(poses[: step + 1]), (VIEW_PX + GAP_PX, VIEW_PX - SIDE_PX))
        yield canvas


if __name__ == "__main__":
    main()
