"""Example of the page on `thalweg follow`: `python docs/follow_film.py` makes a video and follows it, in a minute.

The video is a flight of ten seconds over a river that nothing is trained on, through a wide lens that looks steeply
down, under a low sun, and under a look of which every number lies outside the ranges of training. Since it is rendered,
the true mask is known: the water that is found is compared with it, and the moves with those of the pilot that flew.
"""

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.core.atomic_io import atomic_path
from thalweg.core.video import read_video, write_video
from thalweg.deploy.follow import Follower, cut_to, follow
from thalweg.encoder.water import PACKAGED_WATER, load_segmenter, water_in
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.render import Camera, Look, Renderer
from thalweg.render.records.appearance import PARAMETERS
from thalweg.render.records.randomisation import Randomisation
from thalweg.train import load_policy
from thalweg.world import World, load_or_build

PATH = Path(__file__).resolve().parent / "images" / "follow.webp"
LEVEL, RIVER_SEED, FLIGHT_SEED = "Hard", 4077, 0
"""A river of no training; those of training have seeds from 1000 to 1063, or are the fixed ones of the levels."""
SUN_DEG = 200.0, 12.0
"""Azimuth and elevation of the sun; those of training stand 25 to 70 degrees high."""
CAMERA = Camera(height_px=360, width_px=640, fov_deg=80.0, pitch_deg=34.0)
"""Camera of the video; those of training have 54 to 66 degrees, and look 15 to 25 degrees down."""
LOOK = Look(
    haze=6.5, exposure_ev=0.75, warmth=0.7, water_tint=0.85, turbidity=3.5, ripple=2.0, plant_density=0.5, noise=6.5,
    clouds=0.85,
)  # fmt: skip
SAME = ("season", "pitch_deg", "fov_deg")
"""Numbers of the look that are not outside: the season has no values outside; the others are those of the camera."""
FPS, SECONDS, STEP_S = 20, 10, 0.25
SMOOTHED_STEPS = 1.5
"""Standard deviation in steps of the Gaussian that smooths the flight: its steps are 1 m, 0.5 m or 10 degrees."""
CRF = 20
FRAME_MS, WIDTH_PX, QUALITY = 250, 800, 50
"""Time of a picture, and width and quality of WebP; the file stays below 600 kB."""


def main() -> None:
    check_outside(LOOK)
    world = load_or_build(LEVEL, RIVER_SEED).relit(*map(math.radians, SUN_DEG))
    poses, moves = fly(world)
    frames = np.stack(list(draw(world, poses)))
    follower = Follower(load_policy(PACKAGED_POLICY), load_segmenter(PACKAGED_WATER))
    with tempfile.TemporaryDirectory() as folder:
        video, out = Path(folder) / "river.mp4", Path(folder) / "overlay.mp4"
        write_video(video, frames[..., :3], FPS, crf=CRF)
        chosen = follow(video, out, follower, "packaged")
        pictures = [Image.fromarray(frame) for frame in read_video(out)]
        iou, with_true = judge(video, frames[..., 3])
    print(in_words(iou, chosen, with_true, moves))
    save(pictures)


def check_outside(look: Look) -> None:
    """Raise `ValueError` for a number of the look within the range that training draws from."""
    for name in PARAMETERS:
        low, high = getattr(Randomisation(), name)
        if name not in SAME and low <= getattr(look, name) <= high:
            raise ValueError(f"{name} = {getattr(look, name)} is within {low} to {high}, the range of training")


def fly(world: World) -> tuple[np.ndarray, np.ndarray]:
    """Return smoothed poses [T, 4] of the frames of a flight of the steady pilot, and its moves [S, 4] by step."""
    env = RiverVectorEnv([world], 1, EnvConfig(observation="none"))
    _, info = env.reset(seed=FLIGHT_SEED)
    poses, moves = [info["pose"][0]], []
    for _ in range(round(SECONDS / STEP_S)):
        moves.append(env.pilot_actions("steady"))
        _, _, terminated, truncated, info = env.step(moves[-1])
        assert not (terminated[0] or truncated[0]), "the flight ended early: choose another FLIGHT_SEED"
        poses.append(info["pose"][0])
    steps = np.array(poses)
    steps[:, 3] = np.unwrap(steps[:, 3])
    at = np.arange(FPS * SECONDS) / (FPS * STEP_S)
    weights = np.exp(-0.5 * ((at[:, None] - np.arange(len(steps))) / SMOOTHED_STEPS) ** 2)
    return weights @ steps / weights.sum(1, keepdims=True), np.concatenate(moves)


def draw(world: World, poses: np.ndarray) -> Iterator[np.ndarray]:
    """Yield frames [H, W, 4] uint8, colours and mask, of poses [T, 4]."""
    renderer = Renderer([world], CAMERA)
    for number, pose in enumerate(poses):
        yield renderer.render(pose[None], time_s=number / FPS, look=LOOK)[0]


def judge(video: Path, masks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return IoU [S] of the water found and the true one in each step, as the policy's camera sees them, and the moves
    [S, 4] that the policy chooses with the true one; `masks` [T, H, W] uint8 are those of the video."""
    policy, segmenter = load_policy(PACKAGED_POLICY), load_segmenter(PACKAGED_WATER)
    player, size_px = policy.player(1, deterministic=True), Follower(policy, segmenter).size_px
    iou, moves = [], []
    for frame, mask in list(zip(read_video(video), masks, strict=True))[:: round(FPS * STEP_S)]:
        colours, true = cut_to(frame, size_px), cut_to(mask[..., None].repeat(3, -1), size_px)[..., :1] > 127
        found = water_in(segmenter, colours[None])[0][..., None]
        iou.append((found & true).sum() / (found | true).sum())
        seen = np.concatenate([colours, true.astype(np.uint8) * 255], axis=-1)
        moves.append(player(seen[None], np.array([not moves]))[0])
    return np.array(iou), np.array(moves)


def in_words(iou: np.ndarray, moves: np.ndarray, with_true: np.ndarray, flown: np.ndarray) -> str:
    """Return what is measured: IoU [S] of the water, and how many moves [S, 4] of the policy agree with those that it
    chooses with the true mask, and with those that the pilot flew."""
    same, turns, true_turns = (moves == with_true).sum(0), *((one == flown)[:, 1].sum() for one in (moves, with_true))
    branches = ", ".join(f"{name} {n}" for name, n in zip(("climb", "turn", "ahead", "aside"), same, strict=True))
    steps = np.round(iou, 2).tolist()
    return (
        f"IoU of water {iou.mean():.2f}, from {iou.min():.2f} to {iou.max():.2f}; by step: {steps}\n"
        f"of {len(moves)} moves as with the true mask: {branches}\n"
        f"turns as the pilot's: {turns}, with the true mask {true_turns}"
    )


def save(pictures: list[Image.Image]) -> None:
    """Write the animation of the page."""
    size = WIDTH_PX, round(WIDTH_PX * pictures[0].height / pictures[0].width)
    small = [picture.resize(size, Image.Resampling.LANCZOS) for picture in pictures]
    with atomic_path(PATH) as draft:
        small[0].save(
            draft, save_all=True, append_images=small[1:], duration=FRAME_MS, loop=0, quality=QUALITY, method=6
        )
    print(f"docs/images/{PATH.name}: {len(small)} pictures, {PATH.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
