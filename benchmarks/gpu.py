"""Parity of this GPU with the CPU, and its speed.

    python benchmarks/gpu.py [--out gpu.csv] [--minutes 7]

checks frames, codes and rules against the CPU, then times frames, rules, codes, tasks and training for 64 to 16,384
cameras in 1 to 64 worlds. It prints a table and writes a row for each figure, with the card's name; what the time limit
leaves out is missing. A bare machine needs Python 3.11, a torch that was built for CUDA, numba-cuda, and what the
package needs anyway (requirements.lock); worlds are built by all cores, in about a minute.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, fields
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.interface import Task
from thalweg.algos.offpolicy.config import OffPolicyConfig
from thalweg.algos.registry import algorithm_named
from thalweg.bench.csv_files import csv_text
from thalweg.cli.options import settings_from
from thalweg.core.atomic_io import write_atomic
from thalweg.core.compute.device import DeviceError, resolve_device
from thalweg.core.parent_process import end_with_parent
from thalweg.encoder import Encoder, load_encoder
from thalweg.env import EnvConfig, sample_starts, tasks
from thalweg.env.torch_env import TensorRiverEnv
from thalweg.render import Renderer
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.train.latent import LatentTensorEnv
from thalweg.train.rollouts.tensor_collector import TensorCollector
from thalweg.train.trainer import Trainer
from thalweg.world import World, load_or_build

HERE = Path(__file__).resolve().parent
COLUMNS = ("card", "what", "quality", "cameras", "worlds", "figure", "unit", "wanted", "holds")
CHECKS = {"pixels alike", "steps alike", "poses apart"}
"""Rows without which docs/devices.md cannot be written."""
WITHIN, SHARE = 2, 0.999
"""Largest difference (of 255) of equal pixels, and the required share of equal pixels."""
POSE_M = 1e-9
"""Largest difference of equal poses."""
STEPS_SHARE = 0.99999
"""Required share of equal steps. Where a start lies equally near two segments of the course, rounding decides for which
it counts: one step in a million."""
SECONDS = 1.0
"""Least duration of a measurement."""
REPEATS = 3
"""Least number of measured calls, after one for warm-up."""
LEARNERS = ("FOCOPS", "SACLag", "CCEPETS")
"""Algorithms whose training is timed: the first with every number of worlds, the others with the first number only."""


@dataclass
class Table:
    """The rows so far, each printed as it is added."""

    card: str
    rows: list[dict[str, str]] = field(default_factory=list)

    def add(self, what: str, figure: float, unit: str, wanted: float | None = None, holds: bool | None = None, **at):
        """Add a figure; checks also have the `wanted` value and whether it `holds`."""
        row = {"card": self.card, "what": what, "figure": f"{figure:.6g}", "unit": unit}
        row |= {name: str(value) for name, value in at.items()}
        row |= {} if wanted is None else {"wanted": f"{wanted:g}", "holds": "yes" if holds else "NO"}
        self.rows.append({name: row.get(name, "") for name in COLUMNS})
        print("  ".join(f"{name} {row[name]}" for name in COLUMNS[1:] if row.get(name)), flush=True)

    def write(self, path: Path) -> None:
        write_atomic(path, csv_text(COLUMNS, ([row[name] for name in COLUMNS] for row in self.rows)))


class Clock:
    """Times calls on a device, and tells when the time limit is reached."""

    def __init__(self, device: torch.device, minutes: float) -> None:
        self.device, self.end = device, time.monotonic() + 60 * minutes

    @property
    def is_over(self) -> bool:
        return time.monotonic() >= self.end

    def rate(self, call: Callable[[], object], each: int) -> float:
        """Return units per second, of which each call does `each`."""
        call()
        self.wait()
        begin, calls = time.perf_counter(), 0
        while calls < REPEATS or time.perf_counter() - begin < SECONDS:
            call()
            calls += 1
            self.wait()
        return calls * each / (time.perf_counter() - begin)

    def wait(self) -> None:
        """Wait until the device has finished."""
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)


def build_river(seed: int) -> int:
    """Build a river into the cache folder; return its seed."""
    load_or_build("Medium", seed)
    return seed


def rivers(count: int) -> list[World]:
    """Return Medium's rivers of the first seeds, built on all cores."""
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), end_with_parent) as pool:
        return [load_or_build("Medium", seed) for seed in pool.map(build_river, range(count))]


def views(
    worlds: Sequence[World], count: int, renderer: Renderer, device: torch.device, seed: int = 0
) -> tuple[Tensor, ...]:
    """Return the inputs of `Renderer.render_tensors` for `count` cameras at random safe poses, drawn from `seed`."""
    several = [sample_starts(world, -(-count // len(worlds)), seed + place) for place, world in enumerate(worlds)]
    poses = np.concatenate(several, 1).reshape(-1, 4)[:count]  # the worlds in turn
    index = np.arange(count) % len(worlds)
    rows = np.repeat(look_rows(look_values(None, 1), renderer.camera), count, 0)
    arrays = index.astype(np.int64), np.ascontiguousarray(poses), np.zeros(count), rows
    return tuple(torch.from_numpy(array).to(device) for array in arrays)


def render_frames(worlds: Sequence[World], count: int, quality: str, device: torch.device) -> Tensor:
    """Return frames [count, H, W, 4] on the host."""
    renderer = Renderer(worlds, quality=quality, device=str(device))  # pyright: ignore[reportArgumentType]
    camera = renderer.camera
    frames = torch.empty(count, camera.height_px, camera.width_px, 4, dtype=torch.uint8, device=device)
    renderer.render_tensors(views(worlds, count, renderer, device), frames)
    return frames.cpu()


def check_frames(table: Table, worlds: Sequence[World], count: int, device: torch.device) -> None:
    """Compare frames and masks of both qualities, and codes of the full one."""
    for quality in ("full", "fast"):
        here, there = (render_frames(worlds, count, quality, side).int() for side in (torch.device("cpu"), device))
        apart = (here - there).abs()
        alike = float((apart[..., :3].amax(-1) <= WITHIN).float().mean())
        masks = float((apart[..., 3] == 0).float().mean())
        at = {"quality": quality, "cameras": count, "worlds": len(worlds)}
        table.add("pixels alike", alike, "share", SHARE, alike >= SHARE, **at)
        table.add("masks alike", masks, "share", SHARE, masks >= SHARE, **at)
        if quality == "full":
            frames = here.to(torch.uint8)
            codes = [load_encoder(device=str(side)).of_tensor(frames.to(side)).cpu() for side in ("cpu", device)]
            most = float((codes[0] - codes[1]).abs().max())
            table.add("codes apart", most, "deviations", 1e-2, most <= 1e-2, **at)


def check_rules(
    table: Table, worlds: Sequence[World], envs: int, steps: int, device: torch.device, **options: Any
) -> None:
    """Compare done reasons, rewards, costs and poses of both sides under the same random actions; `options` are more
    settings of `EnvConfig`."""
    config = EnvConfig(observation="none", **options)
    sides = [TensorRiverEnv(worlds, envs, config, device=str(side)) for side in ("cpu", device)]
    for side in sides:
        side.reset(seed=0)
    generator, alike, furthest = torch.Generator().manual_seed(0), 0, 0.0
    for _ in range(steps):
        actions = torch.randint(0, 3, (envs, 4), generator=generator) - int(config.action == "continuous")
        (_, reward, *_, here), (_, reward_there, *_, there) = (side.step(actions.to(side.device)) for side in sides)
        same = reward == reward_there.cpu()
        for name in ("costs", "done_reason"):
            equal = here[name] == there[name].cpu()
            same &= equal.all(-1) if equal.dim() > 1 else equal
        alike += int(same.sum())
        furthest = max(furthest, float((here["pose"] - there["pose"].cpu()).abs().max()))
    at = {"cameras": envs, "worlds": len(worlds)}
    share = alike / (envs * steps)
    table.add("steps alike", share, f"share of {envs * steps:,}", STEPS_SHARE, share >= STEPS_SHARE, **at)
    table.add("poses apart", furthest, "m", POSE_M, furthest <= POSE_M, **at)


def time_frames(table: Table, clock: Clock, worlds: Sequence[World], counts: Sequence[int]) -> None:
    """Time frames of both qualities, and their codes."""
    encoder = load_encoder(device=str(clock.device))
    for quality in ("full", "fast"):
        renderer = Renderer(worlds, quality=quality, device=str(clock.device))
        camera = renderer.camera
        for count in while_there_is_time(clock, counts):
            inputs = views(worlds, count, renderer, clock.device)
            size = count, camera.height_px, camera.width_px, 4
            frames = torch.empty(size, dtype=torch.uint8, device=clock.device)
            at: dict[str, Any] = {"cameras": count, "worlds": len(worlds)}
            rate = clock.rate(partial(renderer.render_tensors, inputs, frames), count)
            table.add("render", rate, "frames/s", quality=quality, **at)
            if quality == "full":
                table.add(
                    "encode", clock.rate(lambda frames=frames: encoder.of_tensor(frames), count), "frames/s", **at
                )


def time_rules(table: Table, clock: Clock, worlds: Sequence[World], counts: Sequence[int]) -> None:
    """Time steps of the rules alone."""
    for count in while_there_is_time(clock, counts):
        env = TensorRiverEnv(worlds, count, EnvConfig(observation="none"), device=str(clock.device))
        env.reset(seed=0)
        actions = torch.randint(0, 3, (count, 4), device=clock.device)
        table.add("step", clock.rate(partial(env.step, actions), count), "steps/s", cameras=count, worlds=len(worlds))


def time_tasks(table: Table, clock: Clock, worlds: Sequence[World], counts: Sequence[int]) -> None:
    """Time steps of each task with its frames of full quality, in which some have objects."""
    for task in tasks.TASKS:
        for count in while_there_is_time(clock, counts):
            env = TensorRiverEnv(worlds, count, EnvConfig(task=task), device=str(clock.device))
            env.reset(seed=0)
            actions = torch.ones((count, 4), dtype=torch.int64, device=clock.device)
            rate = clock.rate(partial(env.step, actions), count)
            table.add(f"fly {task}", rate, "steps/s", quality="full", cameras=count, worlds=len(worlds))


def time_training(
    table: Table,
    clock: Clock,
    worlds: Sequence[World],
    counts: Sequence[int],
    encoder: Encoder,
    learners: Sequence[str],
    settings: Mapping[str, Any],
) -> None:
    """Time complete training after its random steps: frames, codes, rules, actions and updates.

    Off-policy algorithms on a GPU are timed with and without CUDA graphs. Each algorithm takes those of the settings
    that it has; its other defaults depend on the number of environments.
    """
    for learner in learners:
        recorded = clock.device.type == "cuda" and issubclass(algorithm_named(learner).config, OffPolicyConfig)
        for graphs in (False, True) if recorded else (False,):
            for count in while_there_is_time(clock, counts):
                trainer = start_training(learner, worlds, count, encoder, settings, graphs)
                steps = count * trainer.learner.rollout_steps
                rate = clock.rate(partial(update, trainer), steps)
                name = f"train {learner}, graphs" if graphs else f"train {learner}"
                table.add(name, rate, "steps/s", cameras=count, worlds=len(worlds))


def start_training(
    learner: str,
    worlds: Sequence[World],
    count: int,
    encoder: Encoder,
    settings: Mapping[str, Any],
    graphs: bool = False,
) -> Trainer:
    """Return a training run on tensors, past its random steps."""
    river = TensorRiverEnv(worlds, count, device=str(encoder.device))
    env: Any = LatentTensorEnv(river, encoder)  # the rest of `TensorEnv` is that of the river
    entry = algorithm_named(learner)
    known = {field.name for field in fields(entry.config)}
    config = entry.configure({key: value for key, value in settings.items() if key in known}, num_envs=count)
    collector = TensorCollector(env, config.frame_stack, 1)
    task = Task(collector.obs_size, env.single_action_space, count, 0, {}, encoder.device, graphs)
    trainer = Trainer(collector, entry.make(config, task), 10**9, seed=0, threads=1)
    trainer.start()
    while trainer.statistics.steps < getattr(config, "random_steps", 0):
        update(trainer)
    return trainer


def update(trainer: Trainer) -> None:
    """Collect a rollout and update."""
    while not trainer.ready:
        trainer.step()
    trainer.update()


def while_there_is_time(clock: Clock, counts: Sequence[int]) -> Iterator[int]:
    """Yield counts until the time limit is reached."""
    for count in counts:
        if clock.is_over:
            return
        yield count


def main() -> int:
    parser = argparse.ArgumentParser(description="The river on a GPU: parity, then speed")
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--cameras", type=int, nargs="+", default=[64, 256, 1024, 4096, 16384])
    parser.add_argument("--worlds", type=int, nargs="+", default=[1, 16, 64])
    parser.add_argument("--check", type=int, default=256, help="number of frames compared with the CPU's")
    parser.add_argument("--check-steps", type=int, default=1_000_000, help="number of steps compared with the CPU's")
    parser.add_argument("--minutes", type=float, default=7.0, help="time limit; no measurement starts after it")
    parser.add_argument("--set", nargs="*", default=[], help="settings of the learners, such as steps_per_update=4096")
    parser.add_argument("--out", type=Path, default=HERE / "gpu.csv")
    given = parser.parse_args()
    if min([*given.cameras, *given.worlds, given.check, given.check_steps]) < 1:
        parser.error("cameras, worlds and checks must be at least 1")
    try:
        device = torch.device(resolve_device(given.device))
    except DeviceError as error:
        print(error, file=sys.stderr)
        return 1
    card = torch.cuda.get_device_name(device) if device.type == "cuda" else "none, the CPU"
    settings = settings_from(given.set)
    table, clock = Table(card), Clock(device, given.minutes)
    print(f"{card}; torch {torch.__version__}, CUDA {torch.version.cuda}", flush=True)
    pool = rivers(max(given.worlds))
    try:
        check_frames(table, pool[: min(2, len(pool))], given.check, device)
        envs = min(4096, given.check_steps)
        check_rules(table, pool[: min(2, len(pool))], envs, max(1, given.check_steps // envs), device)
        encoder = load_encoder(device=str(device))
        for count in while_there_is_time(clock, given.worlds):
            time_frames(table, clock, pool[:count], given.cameras)
            time_rules(table, clock, pool[:count], given.cameras)
        batches = [count for count in given.cameras if count <= 4096]
        time_tasks(table, clock, pool[: given.worlds[0]], batches[-1:])
        for index, count in enumerate(while_there_is_time(clock, given.worlds)):
            learners = LEARNERS if index == 0 else LEARNERS[:1]
            time_training(table, clock, pool[:count], batches, encoder, learners, settings)
    finally:
        checked = {row["what"] for row in table.rows} >= CHECKS
        path = given.out if checked else given.out.with_suffix(".part.csv")
        if table.rows:
            table.write(path)
            print(f"{path}: {len(table.rows)} rows", flush=True)
    return int(any(row["holds"] == "NO" for row in table.rows))


if __name__ == "__main__":
    sys.exit(main())
