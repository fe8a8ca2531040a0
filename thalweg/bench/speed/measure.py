"""Speed measurements of each part, with everything that a figure depends on.

A figure is the median of several repetitions, with the slowest and the fastest of them. Compilation and world building
are done before the clock starts, except in the lines that say otherwise.
"""

import itertools
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch

from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.policy import Policy
from thalweg.bench.csv_files import read_csv
from thalweg.bench.speed.frame_profile import REFLECTION, STAGES, profile_frame
from thalweg.core.parent_process import ending_with_parent
from thalweg.encoder import VAE, Encoder, VAEConfig
from thalweg.env import EnvConfig, RiverVectorEnv, sample_starts
from thalweg.render import Camera, Renderer
from thalweg.render.records.quality import Quality
from thalweg.train.latent import LatentVectorEnv
from thalweg.train.river import load_compatible_encoder
from thalweg.world import World, build, level_named, load_or_build

BATCH, WORLDS = 16, 4
"""Environments that are stepped together, and distinct rivers among them."""
VIEWS = 64
"""Number of views over which the stages of a frame are measured."""
FRAME_FEATURES = "RGB, water mask, everything drawn"
MASK_FEATURES = "water mask alone; no colours, plants only where they hide water"
FEATURES: dict[Quality, str] = {
    "full": FRAME_FEATURES,
    "fast": "RGB, water mask; reflects only the sky, nearest look-ups, interpolated ground",
}


@dataclass(frozen=True)
class Plan:
    """Length of the measurements."""

    repeats: int = 7
    seconds: float = 1.0
    """Least duration of each repetition."""
    train_steps: int = 16_384
    """Steps of the training run, eight updates of FOCOPS, of which the first does not count; 0 measures no training."""
    cold: bool = True
    """Whether the first start is measured, with nothing compiled or built."""


QUICK = Plan(repeats=3, seconds=0.3, train_steps=0, cold=False)


@dataclass(frozen=True)
class Measurement:
    """One line of the table."""

    name: str
    unit: str
    median: float
    slowest: float
    fastest: float
    repeats: int
    batch: int
    worlds: int
    resolution: str
    """Resolution of frames; empty where none is drawn."""
    features: str


def rates(work: Callable[[], int], plan: Plan, clock: Callable[[], float] = time.perf_counter) -> list[float]:
    """Return the units of work per second in each repetition; `work` does some units and returns how many.

    The first call, which may compile, is not counted. `clock` returns seconds.
    """
    work()
    repetitions = []
    for _ in range(plan.repeats):
        done, start = 0, clock()
        while (elapsed := clock() - start) < plan.seconds:
            done += work()
        repetitions.append(done / elapsed)
    return repetitions


def _measurement(
    name: str, unit: str, values: list[float], *, batch: int = BATCH, worlds: int = WORLDS, **words: str
) -> Measurement:
    """Return median, slowest and fastest of some values: rates per second, or durations."""
    slowest, fastest = (min(values), max(values)) if unit.endswith("/s") else (max(values), min(values))
    median = statistics.median(values)
    resolution, features = words.get("resolution", ""), words.get("features", "")
    return Measurement(name, unit, median, slowest, fastest, len(values), batch, worlds, resolution, features)


def measure(plan: Plan) -> Iterator[Measurement]:
    """Yield every line of the table, each as soon as it is measured."""
    level = level_named("Medium")
    worlds = [load_or_build(level, seed) for seed in range(WORLDS)]
    yield from _rendering(plan, worlds)
    yield from _stepping(plan, worlds)
    yield from _worlds_and_starts(plan)
    if plan.train_steps:
        yield from _training(plan)


def measure_stages(plan: Plan) -> Iterator[Measurement]:
    """Yield a line for each stage of a frame: milliseconds on one thread, with the slowest and fastest view."""
    world = load_or_build(level_named("Medium"), 0)
    times_ms = profile_frame(world, Camera(), views=VIEWS, repeats=plan.repeats)
    total = sum(statistics.mean(times_ms[name]) for name in STAGES if name != REFLECTION)
    for name, times in times_ms.items():
        share = f"{statistics.mean(times) / total:.0%} of the frame; one thread, {VIEWS} random views of Medium"
        yield Measurement(
            name, "ms", statistics.mean(times), max(times), min(times), plan.repeats, 1, 1, "128x128", share
        )  # fmt: skip


def _rendering(plan: Plan, worlds: list[World]) -> Iterator[Measurement]:
    index = np.arange(BATCH) % len(worlds)
    poses = np.array([sample_starts(worlds[world], BATCH, 0)[row] for row, world in enumerate(index)])
    cases: list[tuple[int, Quality]] = [(128, "full"), (128, "fast"), (384, "full")]
    for size, quality in cases:
        renderer = Renderer(worlds, Camera(height_px=size, width_px=size), quality)
        frames = np.empty((BATCH, size, size, 4), dtype=np.uint8)

        def draw(renderer: Renderer = renderer, frames: np.ndarray = frames) -> int:
            renderer.render(poses, index, np.zeros(BATCH), frames)
            return BATCH

        name = "render" if quality == "full" else f"render, {quality}"
        yield _measurement(name, "frames/s", rates(draw, plan), resolution=f"{size}x{size}", features=FEATURES[quality])
    masking, masks = Renderer(worlds, Camera()), np.empty((BATCH, 128, 128), np.uint8)

    def draw_masks() -> int:
        masking.render_mask(poses, index, masks)
        return BATCH

    yield _measurement(
        "render, mask", "frames/s", rates(draw_masks, plan), resolution="128x128", features=MASK_FEATURES
    )
    single = Renderer(worlds[:1], Camera())

    def draw_one() -> int:
        single.render(poses[:1])
        return 1

    words = {"resolution": "128x128", "features": f"{FEATURES['full']}; all cores on one frame"}
    yield _measurement("render, one camera", "frames/s", rates(draw_one, plan), batch=1, worlds=1, **words)


def _steps(env, actions: Callable[[np.ndarray], np.ndarray]) -> Callable[[], int]:
    """Return work that takes eight steps of an environment with the actions for its observations."""
    obs, _ = env.reset(seed=0)

    def work() -> int:
        nonlocal obs
        for _ in range(8):
            obs, *_ = env.step(actions(obs))
        return 8 * env.num_envs

    return work


def _stepping(plan: Plan, worlds: list[World]) -> Iterator[Measurement]:
    rules = RiverVectorEnv(worlds, BATCH, EnvConfig(observation="none"))
    full = RiverVectorEnv(worlds, BATCH)
    rules.action_space.seed(0)
    random_actions = np.stack([rules.action_space.sample() for _ in range(64)])
    counter = itertools.count()

    def random(_: np.ndarray) -> np.ndarray:
        return random_actions[next(counter) % len(random_actions)]

    size = "128x128"
    yield _measurement("step, rules only", "steps/s", rates(_steps(rules, random), plan), features="random actions")
    features = f"{FRAME_FEATURES}; random actions"
    yield _measurement("step", "steps/s", rates(_steps(full, random), plan), resolution=size, features=features)
    masked = RiverVectorEnv(worlds, BATCH, EnvConfig(observation="mask"))
    features = f"{MASK_FEATURES}; random actions"
    yield _measurement("step, mask", "steps/s", rates(_steps(masked, random), plan), resolution=size, features=features)
    encoder = load_compatible_encoder()
    latent = LatentVectorEnv(full, encoder)
    frames = full.reset(seed=0)[0]
    kind = f"{encoder.inputs} to {encoder.latent} numbers, {encoder.config.architecture} architecture"

    def encode() -> int:
        encoder(frames)
        return BATCH

    yield _measurement("encode", "frames/s", rates(encode, plan), resolution=size, features=kind)
    yield _measurement("step + encode", "steps/s", rates(_steps(latent, random), plan), resolution=size, features=kind)
    policy = Policy(encoder.latent, actions_of(full.single_action_space))
    act = partial(policy.act, deterministic=False, generator=torch.Generator().manual_seed(0))
    mask_encoder, mask_kind = _mask_encoder(encoder)
    masked_latent = LatentVectorEnv(masked, mask_encoder)
    for name, env, what in (("", latent, kind), (", mask", masked_latent, mask_kind)):
        speeds = rates(_steps(env, act), plan)
        features = f"{what}; policy of 2 x 64 units, sampled"
        yield _measurement(f"step + encode + policy{name}", "steps/s", speeds, resolution=size, features=features)


def _mask_encoder(packaged: Encoder) -> tuple[Encoder, str]:
    """Return an encoder of masks, with its description: the packaged one, or an untrained one of its architecture."""
    architecture = packaged.config.architecture
    words = f"mask to {packaged.latent} numbers, {architecture} architecture"
    if packaged.inputs == "mask":
        return packaged, words
    config = VAEConfig(inputs="mask", latent=packaged.latent, architecture=architecture)
    return Encoder(VAE(config)), f"{words}, untrained"


def _worlds_and_starts(plan: Plan) -> Iterator[Measurement]:
    for name in ("Easy", "Medium", "Hard"):
        seconds = []
        for seed in range(100, 100 + min(plan.repeats, 3)):
            start = time.perf_counter()
            build(level_named(name), seed)
            seconds.append(time.perf_counter() - start)
        yield _measurement(f"build a world, {name}", "s", seconds, batch=1, worlds=1, features="with its light")
    first_frame = "import gymnasium, thalweg; gymnasium.make('thalweg/Medium-v0').reset(seed=0)"
    warm = [_run_python(["-c", first_frame])[0] for _ in range(1 + min(plan.repeats, 3))][1:]
    yield _measurement(
        "start to first frame, again", "s", warm, batch=1, worlds=1, resolution="128x128", features="new process"
    )
    if plan.cold:
        with tempfile.TemporaryDirectory() as folder:
            cold, _ = _run_python(["-c", first_frame], THALWEG_CACHE=folder)
        features = "new process, nothing compiled, no world built"
        yield _measurement(
            "start to first frame, the first", "s", [cold], batch=1, worlds=1, resolution="128x128", features=features
        )


def _training(plan: Plan) -> Iterator[Measurement]:
    """Yield the speed, the start-up time and the memory of a training run by the command line."""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "run"
        command = ["-m", "thalweg.cli.main", "train", "--algorithm", "FOCOPS", "--steps", str(plan.train_steps)]
        command += ["--world-seeds", *map(str, range(WORLDS)), "--num-envs", str(BATCH), "--out", str(folder)]
        seconds, memory = _run_python(command)
        updates = [
            (float(row["steps_per_second"]), float(row["seconds"]))
            for row in read_csv(folder / "metrics.csv", ("steps_per_second", "seconds"))
        ]
    speeds = [speed for speed, _ in updates[1:]]
    each = f"{len(speeds)} updates of {plan.train_steps // len(updates):,} steps each, after the first"
    features = f"FOCOPS on Medium, frames included; {each}"
    yield _measurement("train", "steps/s", speeds, resolution="128x128", features=features)
    overhead = seconds - updates[-1][1]
    yield _measurement(
        "start and end of training", "s", [overhead], resolution="128x128", features="new process, all cached"
    )
    if not math.isnan(memory):
        yield _measurement("memory of training", "MiB", [memory], resolution="128x128", features="largest resident set")


def _run_python(arguments: list[str], **environment: str) -> tuple[float, float]:
    """Run Python with these arguments; return its seconds and its peak memory in MiB, or nan on Windows.

    Raises if it fails.
    """
    command = ending_with_parent([sys.executable, *arguments])
    start = time.perf_counter()
    process = subprocess.Popen(command, env={**os.environ, **environment}, stdout=subprocess.DEVNULL)
    memory = math.nan
    if hasattr(os, "wait4"):
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        memory = usage.ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
    if process.wait():
        raise subprocess.CalledProcessError(process.returncode, process.args)
    return time.perf_counter() - start, memory
