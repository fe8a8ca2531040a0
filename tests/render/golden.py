"""The six golden frames kept beside this file, and the tolerance within which a frame equals one of them.

`python tests/render/golden.py` compares the frames of this machine with the golden ones; `--write` renders them again
after a change that is meant to be visible. It refuses while `RENDER_VERSION` is still the version of the golden frames,
because policies trained on the older frames could not notice the change, unless the rivers themselves have changed.
"""

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from thalweg.core.atomic_io import atomic_path, write_atomic
from thalweg.env import sample_starts
from thalweg.render import RENDER_VERSION, Look, Renderer
from thalweg.world import World, load_or_build

FOLDER = Path(__file__).resolve().parent / "golden_frames"
SEEDS = {"Easy": 8, "Medium": 109, "Hard": 211}
"""Of the poses in each level; chosen for water near and far, glitter, forest, and bridges from near."""
LEVELS = tuple(SEEDS)
EACH = 2
"""Frames of each level."""
OFF = 12
"""Codes of 255 in any channel by which a pixel must differ to count as off."""
SAME_RIVER = 1e-4
"""Relative difference of a river's figures by which it still counts as the same river."""


@dataclass(frozen=True)
class Tolerance:
    """How far a frame may be from the kept one, on another machine.

    Another processor rounds otherwise, so that here and there a ray passes a leaf or a stone by. Frames and rivers that
    were compiled for the plainest x86-64, without AVX and fused multiplication, differed from those of AVX-512 by at
    most 0.002, 0.001, 0.01 % and 0.006 % in the order of the fields; these limits leave room for other libraries and
    architectures. An exposure 3 % higher gives a mean and a bias of 1.0 and more.
    """

    mean: float
    """Mean absolute difference over pixels and channels, in codes of 255."""
    bias: float
    """Absolute value of the mean difference of any channel."""
    off: float
    """Share of pixels that differ by more than `OFF` in some channel."""
    mask: float
    """Share of pixels whose mask differs."""


TOLERANCE = Tolerance(mean=0.1, bias=0.05, off=0.005, mask=0.001)


@dataclass(frozen=True)
class Difference:
    """How far a frame is from the kept one; fields as of `Tolerance`."""

    mean: float
    bias: float
    off: float
    mask: float

    @property
    def near(self) -> bool:
        return all(getattr(self, name) <= getattr(TOLERANCE, name) for name in self.__dataclass_fields__)

    def __str__(self) -> str:
        return (
            f"mean difference {self.mean:.3f} of 255 (limit {TOLERANCE.mean}), bias {self.bias:.3f} (limit"
            f" {TOLERANCE.bias}), {self.off:.3%} of pixels off by more than {OFF} (limit {TOLERANCE.off:.1%}), mask"
            f" other at {self.mask:.3%} (limit {TOLERANCE.mask:.1%})"
        )


def difference(frame: np.ndarray, kept: np.ndarray) -> Difference:
    """How far frames [H, W, 4] uint8, colours and mask, are from each other."""
    apart = frame[..., :3].astype(int) - kept[..., :3]
    return Difference(
        mean=float(np.abs(apart).mean()),
        bias=float(np.abs(apart.mean(axis=(0, 1))).max()),
        off=float((np.abs(apart) > OFF).any(axis=-1).mean()),
        mask=float((frame[..., 3] != kept[..., 3]).mean()),
    )


def names() -> list[str]:
    """What the frames are called, in their order."""
    return [f"{level.lower()}-{number}" for level in LEVELS for number in range(EACH)]


def draw(worlds: list[World], poses: list[list[float]], look: Look | None = None) -> np.ndarray:
    """[K, H, W, 4] uint8: `EACH` frames of each world at poses [K, 4], each with its own ripples."""
    times = 1.5 * np.arange(len(poses))
    return Renderer(worlds).render(poses, np.repeat(np.arange(len(worlds)), EACH), times, look=look)


def choose(worlds: list[World]) -> list[list[float]]:
    """[K, 4] safe poses, `EACH` in each world, to the millimetre and the milliradian."""
    return (
        np.concatenate([sample_starts(world, EACH, SEEDS[level]) for level, world in zip(LEVELS, worlds, strict=True)])
        .round(3)
        .tolist()
    )


def figures(world: World) -> list[float]:
    """Means over a river's maps and plants, which tell whether it is still the same one."""
    maps = (world.ground_m, world.water_m, world.albedo, world.sun, world.sky, world.canopy_m, world.plants.position_m)
    return [float(world.ground_m.size), float(len(world.plants.kind)), *(float(np.mean(m, dtype=float)) for m in maps)]


def load() -> tuple[dict[str, Any], np.ndarray]:
    """What is known of the kept frames, and the frames [K, H, W, 4] uint8."""
    about = json.loads((FOLDER / "about.json").read_text())
    return about, np.stack([read(FOLDER / f"{name}.png") for name in names()])


def poses_of(about: dict[str, Any]) -> list[list[float]]:
    """[K, 4] where the kept frames were drawn from."""
    return [about["poses"][name] for name in names()]


def read(path: Path) -> np.ndarray:
    """[H, W, 4] uint8 from a picture of the colours with the mask on their right."""
    both = np.asarray(Image.open(path).convert("RGB"))
    colours, mask = np.split(both, 2, axis=1)
    return np.concatenate([colours, mask[..., :1]], axis=-1)


def write(worlds: list[World], poses: list[list[float]], frames: np.ndarray) -> None:
    """Keep the frames [K, H, W, 4] as they are."""
    for name, frame in zip(names(), frames, strict=True):
        mask = np.repeat(frame[..., 3:], 3, axis=-1)
        with atomic_path(FOLDER / f"{name}.png") as draft:
            Image.fromarray(np.concatenate([frame[..., :3], mask], axis=1)).save(draft, optimize=True)
    about = {
        "render_version": RENDER_VERSION,
        "made_by": "python tests/render/golden.py --write",
        "poses": dict(zip(names(), poses, strict=True)),
        "rivers": {level: figures(world) for level, world in zip(LEVELS, worlds, strict=True)},
    }
    write_atomic(FOLDER / "about.json", json.dumps(about, indent=2) + "\n")


def other_rivers(about: dict[str, Any], worlds: list[World]) -> list[str]:
    """The levels whose river is not the one of the kept frames."""
    return [
        level
        for level, world in zip(LEVELS, worlds, strict=True)
        if not np.allclose(figures(world), about["rivers"][level], rtol=SAME_RIVER)
    ]


def far_off(frames: np.ndarray, kept: np.ndarray) -> list[str]:
    """A line for each frame [K, H, W, 4] that is not near the kept one."""
    found = zip(names(), map(difference, frames, kept), strict=True)
    return [f"{name}: {apart}" for name, apart in found if not apart.near]


def refusal(about: dict[str, Any], worlds: list[World], frames: np.ndarray, kept: np.ndarray) -> str | None:
    """Why the kept frames must stay as they are, None if they may be replaced."""
    if about["render_version"] != RENDER_VERSION or other_rivers(about, worlds):
        return None
    far = far_off(frames, kept)
    if not far:
        return "the frames are those that are kept, within the tolerance of other machines: nothing to write"
    return "\n".join([*far, f"the picture has changed and RENDER_VERSION is still {RENDER_VERSION}: raise it first"])


def main(arguments: list[str] | None = None) -> str | None:
    """Compare, or write; returns what is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="draw the frames anew and keep them")
    writing = parser.parse_args(arguments).write
    worlds = [load_or_build(level) for level in LEVELS]
    if not writing or (FOLDER / "about.json").is_file():
        about, kept = load()
        frames = draw(worlds, poses_of(about))
        for name, apart in zip(names(), map(difference, frames, kept), strict=True):
            print(f"{name}: {apart}")
        if not writing:
            return "\n".join(far_off(frames, kept)) or None
        if reason := refusal(about, worlds, frames, kept):
            return reason
    poses = choose(worlds)
    write(worlds, poses, draw(worlds, poses))
    print(f"{len(poses)} frames in {FOLDER}")
    return None


if __name__ == "__main__":
    sys.exit(main())
