"""Pictures of failures of the packaged policy: `python docs/failures.py` draws them in about ten minutes.

The policy flies rivers on which nothing is trained, as `benchmarks/any_river.py` does. For each level, with and without
varied looks, the first failure for each reason is shown: what the policy saw in its last steps, and its track on the
map.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from thalweg.bench.evaluate.course import UNSEEN, Course, EvaluationConfig
from thalweg.bench.evaluate.episodes import REASON_TEXT, Episode
from thalweg.bench.evaluate.evaluation import Label, Step, evaluate, observation_function
from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.bench.pictures.film import RiverMap
from thalweg.core.atomic_io import atomic_path
from thalweg.render.records.randomisation import Randomisation
from thalweg.train import load_policy
from thalweg.world import World

PATH = Path(__file__).resolve().parent / "images" / "failures.webp"
RIVERS = 60
"""Rivers of each kind that are flown."""
KINDS = (("Medium", False), ("Hard", False), ("Medium", True), ("Hard", True))
"""Levels, and whether looks vary."""
LAST_STEPS, SHOWN = 24, 4
"""Steps before the end over which the frames that are shown are spread, and the most frames."""
MOST = 3
"""Greatest number of failures of a kind that are shown, each for another reason."""
LOOKS = Randomisation(suns=1)
"""Looks of the varied flights, as in `benchmarks/any_river.py`."""
VIEW_PX, GAP_PX, TEXT_PX, QUALITY = 192, 6, 22, 70
PAPER, INK = (255, 255, 255), (24, 28, 32)


@dataclass(frozen=True)
class Failure:
    """A flight of T steps that did not succeed."""

    world: World
    episode: Episode
    varied: bool
    frames: Sequence[np.ndarray]
    """T images [H, W, C] uint8, as the policy saw them."""
    poses: np.ndarray
    """[T, 4] x, y, z in metres and the heading in radians."""

    @property
    def title(self) -> str:
        """Level, river, reason, length and return, on one line."""
        looks = ", varied looks" if self.varied else ""
        ended = REASON_TEXT[self.episode.reason]
        steps = "step" if self.episode.length == 1 else "steps"
        return (
            f"{self.episode.level}, river {self.world.seed:,}{looks}: {ended} after {self.episode.length} {steps},"
            f" return {self.episode.return_:.2f}"
        )


def main() -> None:
    policy = load_policy(PACKAGED_POLICY)
    rows = []
    for level, varied in KINDS:
        shown: dict[str, Failure] = {}
        for failure in failures(policy, level, varied):
            shown.setdefault(failure.episode.reason, failure)
            if len(shown) == MOST:
                break
        rows += map(picture, shown.values())
    with atomic_path(PATH) as draft:
        stacked(rows).save(draft, quality=QUALITY, method=6)
    print(f"docs/images/{PATH.name}: {len(rows)} failures")


def failures(policy: Any, level: str, varied: bool) -> Iterator[Failure]:
    """Fly the rivers of a level, and yield the flights that do not succeed."""
    config = EvaluationConfig(RIVERS, deterministic=True)
    for index, course in enumerate(Course.of_seeds(level, range(UNSEEN, UNSEEN + RIVERS), config)):
        single = (course.varied(LOOKS, config) if varied else course).only(index)
        observe = observation_function(policy, single, None)
        assert observe is not None
        frames: list[np.ndarray] = []
        steps: list[Step] = []

        def watched(step: Step, frames: list = frames, steps: list = steps, observe: Any = observe) -> Any:
            steps.append(step)
            frames.append(np.array(seen := observe(step))[0])
            return seen

        (episode,) = evaluate(policy, single, Label("packaged", 0, level), config, observe=watched)
        if not episode.success:
            yield Failure(course.world, episode, varied, frames, np.concatenate([step.poses for step in steps]))


def picture(failure: Failure) -> Image.Image:
    """Return the last frames of a flight and a map with its track, side by side below its title."""
    last = len(failure.frames) - 1
    steps = np.unique(np.linspace(max(0, last - LAST_STEPS), last, SHOWN).round().astype(int))
    frames = [np.ascontiguousarray(failure.frames[step][..., :3]) for step in steps]
    tiles = [Image.fromarray(frame).resize((VIEW_PX, VIEW_PX)) for frame in frames]
    tiles += [Image.new("RGB", (VIEW_PX, VIEW_PX), PAPER)] * (SHOWN - len(tiles))
    tiles.append(RiverMap(failure.world, VIEW_PX, failure.poses[-1, :2]).with_track(failure.poses))
    board = Image.new("RGB", (len(tiles) * (VIEW_PX + GAP_PX) - GAP_PX, TEXT_PX + VIEW_PX), PAPER)
    ImageDraw.Draw(board).text((0, 2), failure.title, INK, ImageFont.load_default(size=14))
    for index, tile in enumerate(tiles):
        board.paste(tile, (index * (VIEW_PX + GAP_PX), TEXT_PX))
    return board


def stacked(rows: Sequence[Image.Image]) -> Image.Image:
    """Return pictures below each other."""
    board = Image.new("RGB", (max(row.width for row in rows), sum(row.height + GAP_PX for row in rows) - GAP_PX), PAPER)
    top = 0
    for row in rows:
        board.paste(row, (0, top))
        top += row.height + GAP_PX
    return board


if __name__ == "__main__":
    main()
