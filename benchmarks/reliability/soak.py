"""Soak of the environment: rules of all tasks over many rivers, and frames, without NaN and without an illegal state.

    python benchmarks/reliability/soak.py                        # 100 pieces of a million steps on ten rivers each
    python benchmarks/reliability/soak.py --frames               # 100 pieces of 10,000 frames of ten rivers each
    python benchmarks/reliability/soak.py --pieces 3
    python benchmarks/reliability/soak.py --minutes 25           # begins no piece later than that
    python benchmarks/reliability/soak.py --smoke                # one river, a few steps, no table

A piece flies every task with the UAV and the paper's with the boat, 256 vehicles at a time, half of them by the pilot,
half at random. After every step all numbers are finite, costs are not negative, returns stay below the greatest one,
and no episode is longer than its limit; every sixteenth step each vehicle is within its heights and its banks, by a
projection that is computed here, without the rules. A frame is not of one colour, has distances where it has no sky,
and is the same when it is drawn again. soak_steps.csv and soak_frames.csv have a row for each piece; a piece
that has a row without a fault is skipped.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from pieces import Clock, Pieces

from thalweg.core import versions
from thalweg.env import ConfigError, EnvConfig, RiverVectorEnv
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.task.reward_cost import FULL_COURSE_REWARD
from thalweg.env.tasks import TASKS
from thalweg.env.vehicle.boat import FitError
from thalweg.render import Renderer
from thalweg.render.records.classes import SKY
from thalweg.render.renderer import ALL_LAYERS
from thalweg.world import World

HERE = Path(__file__).resolve().parent
LEVELS = {"uav": ("Easy", "Medium", "Hard"), "asv": ("Easy", "Medium-Deep", "Hard-Deep")}
"""Levels of each vehicle: others are too shallow for the boat."""
FIRST_SEED, RIVERS = 30_000, 10
"""Seed of the first river, and rivers of a piece."""
VEHICLES, STEPS, FRAMES = 256, 1_000_000, 10_000
"""Vehicles at a time, and steps and frames of a piece."""
PIECES = 100
CHECKED_EVERY = 16
"""Steps between two checks of all states."""
SLACK = 1e-6
"""Metres and points of return by which a bound may be exceeded: the rules round otherwise."""
STRAY_M = 1000.0
"""Distance from the course that no vehicle reaches in an episode, where land may be crossed."""
PIECE = ("piece", "rivers", "amount")
MADE_WITH = {"steps": ("world", "rules", "tasks", "vehicles"), "frames": ("world", "rules", "render")}
"""Versions that a piece of steps and one of frames depend on, which identify it beside `PIECE`."""


def versions_of(what: str) -> dict[str, int]:
    """Return today's versions of `MADE_WITH`."""
    return {name: getattr(versions, name.upper()) for name in MADE_WITH[what]}


def cases() -> list[EnvConfig]:
    """Return the config of every task that each vehicle has."""
    found = []
    for vehicle in ("uav", "asv"):
        for task in TASKS:
            try:
                found.append(EnvConfig(task=task, vehicle=vehicle, observation="none"))
            except ConfigError:  # the boat has the paper's task only
                continue
    return found


def river_list(piece: int, rivers: int, vehicle: str = "uav") -> RiverList:
    """Return the rivers of a piece, of all levels of a vehicle in turn."""
    numbers, levels = range(piece * RIVERS, piece * RIVERS + rivers), LEVELS[vehicle]
    return RiverList.of_levels([(levels[number % len(levels)], FIRST_SEED + number) for number in numbers])


def worlds_for(piece: int, rivers: int, config: EnvConfig) -> list[World]:
    """Return the worlds of a piece as far as rules need them, without rivers that are refused for the boat's size."""
    listed, worlds = river_list(piece, rivers, config.vehicle), []
    for river in range(rivers):
        if config.vehicle == "uav":
            worlds.append(listed.course(river))
            continue
        with suppress(FitError):
            world = listed.sounded(river)
            pack_courses([world], config)
            worlds.append(world)
    return worlds


class Watch:
    """What is noticed of the episodes of many vehicles."""

    def __init__(self, env: RiverVectorEnv) -> None:
        self.env, self.count = env, env.num_envs
        self.faults: list[str] = []
        self.returns, self.lengths = np.zeros(self.count), np.zeros(self.count, np.int64)
        self.limits = env.courses.max_steps[env.world_index]

    def fault(self, bad: np.ndarray, what: str) -> None:
        """Note the first of the vehicles for which `bad` [N] is true."""
        if np.any(bad):
            row = int(np.argmax(bad))
            pose = self.env.state.pose[row].round(3).tolist()
            self.faults.append(f"{what} (vehicle {row}, river {self.env.world_index[row]}, now at {pose})")

    def step(self, reward: np.ndarray, ended: np.ndarray, info: dict) -> None:
        """Check what a step returned."""
        costs, reason = info["costs"], info["done_reason"]
        numbers = np.column_stack([reward, costs, info["cost"], info["pose"], info["progress"]])
        self.fault(np.logical_not(np.isfinite(numbers).all(axis=1)), "a number that is not finite")
        self.fault((costs < 0).any(axis=1) | (info["cost"] < 0), "a negative cost")
        self.fault((costs > 1).any(axis=1), "a cost of more than 1 of one kind in a step")
        self.fault((info["progress"] < 0) | (info["progress"] > 1 + SLACK), "a progress outside 0 to 1")
        self.fault(ended != (reason >= 0), "an end without a reason, or a reason without an end")
        self.returns += reward
        self.lengths += 1
        self.fault(self.returns > FULL_COURSE_REWARD + SLACK, "a return above the greatest one")
        self.fault(self.lengths > self.limits, "an episode above its step limit")
        self.returns[ended], self.lengths[ended] = 0.0, 0

    def state(self) -> None:
        """Check the state of every vehicle, by a projection on the segment of the course that the state names."""
        state, config, courses = self.env.state, self.env.config, self.env.courses
        world = self.env.world_index
        self.fault(state.steps != self.lengths, "steps of an episode that are not counted as flown")
        self.fault((state.idle < 0) | (state.idle >= config.max_idle_steps), "more idle steps than are allowed")
        self.fault(state.visited.sum(axis=1) != state.visited_count, "visited segments that are not those counted")
        self.fault((state.segment < 0) | (state.segment >= courses.segments[world]), "a segment that is none")
        begin, end = self._segment(world, state.segment)
        along = courses.position[end] - courses.position[begin]
        apart = state.pose[:, :2] - courses.position[begin]
        share = np.clip((along * apart).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
        distance = np.linalg.norm(apart - share[:, None] * along, axis=1)
        level, width = (
            values[begin] + share * (values[end] - values[begin]) for values in (courses.level, courses.width)
        )
        height = state.pose[:, 2] - level
        if config.vehicle == "asv":
            self.fault(abs(height - config.boat.camera_height_m) > SLACK, "a boat that is not on the water")
        else:
            low, high = config.min_height_m - SLACK, config.max_height_m + SLACK
            self.fault((height < low) | (height > high), "a height outside the band")
        over = STRAY_M if config.task_record.portage else SLACK
        self.fault(distance > width / 2 + over, "a place beyond the bank")

    def _segment(self, world: np.ndarray, segment: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the samples at which the segments [N] of worlds [N] begin and end."""
        first, last = self.env.courses.first_sample[world], self.env.courses.first_sample[world + 1]
        begin = first + segment
        return begin, np.where(begin + 1 == last, first, begin + 1)


def fly(worlds: Sequence[World], config: EnvConfig, steps: int, seed: int, vehicles: int = VEHICLES) -> Watch:
    """Fly a number of steps, all vehicles together; returns what was noticed."""
    env, random = RiverVectorEnv(worlds, vehicles, config), np.random.default_rng(seed)
    env.reset(seed=seed)
    watch, straight = Watch(env), np.arange(vehicles) % 2 == 0
    watch.state()
    for number in range(-(-steps // vehicles)):
        actions = random.integers(0, 3, (vehicles, 4))
        guided = straight & (random.random(vehicles) < 0.95)
        if number % CHECKED_EVERY == 0 or guided.any():
            actions[guided] = env.pilot_actions()[guided]
        _, reward, terminated, truncated, info = env.step(actions)
        watch.step(reward, terminated | truncated, info)
        if number % CHECKED_EVERY == 0:
            watch.state()
        if watch.faults:
            break
    env.close()
    return watch


def soak_steps(piece: int, rivers: int, steps: int, vehicles: int = VEHICLES) -> Iterator[str]:
    """Yield the faults of a piece of steps; a vehicle that fits none of its rivers is one."""
    configs = cases()
    for index, config in enumerate(configs):
        worlds = worlds_for(piece, rivers, config)
        if not worlds:  # a piece without it would count as flown
            yield f"{config.vehicle} {config.task}: not flown, since it fits none of the {rivers} rivers"
            continue
        watch = fly(worlds, config, steps // len(configs), piece * len(configs) + index, vehicles)
        yield from (f"{config.vehicle} {config.task}: {fault}" for fault in watch.faults)


def soak_frames(piece: int, rivers: int, frames: int, batch: int = 100) -> Iterator[str]:
    """Yield the faults of a piece of frames, which are drawn from states of episodes at random times."""
    listed, random = river_list(piece, rivers), np.random.default_rng(piece)
    for river in range(rivers):
        world = listed.world(river)
        renderer = Renderer([world])
        env = RiverVectorEnv([world], batch, EnvConfig(observation="none"))
        env.reset(seed=piece * rivers + river)
        for number in range(frames // rivers // batch):
            poses = env.state.pose.copy()
            times = random.uniform(0.0, 1000.0, batch)
            yield from (f"{world.name} {world.seed}: {fault}" for fault in frame_faults(renderer, poses, times, number))
            env.step(random.integers(0, 3, (batch, 4)))
        env.close()


def frame_faults(renderer: Renderer, poses: np.ndarray, times: np.ndarray, number: int) -> Iterator[str]:
    """Yield what is wrong with the frames of poses [N, 4] at times [N]; every tenth batch is drawn twice."""
    frame = renderer.render_layers(poses, time_s=times)
    for row, (image, depth, kind) in enumerate(zip(frame.rgb, frame.depth_m, frame.class_id, strict=True)):
        where = f"at {poses[row].round(3).tolist()}, {times[row]:.3f} s"
        if image.std() == 0:
            yield f"a frame of one colour {where}"
        if not np.isfinite(depth).all() or not np.where(kind == SKY, depth == -1.0, depth > 0.0).all():
            yield f"a depth that is no distance {where}"
    if number % 10 == 0:
        again = renderer.render_layers(poses, time_s=times)
        for name in ALL_LAYERS:
            if not np.array_equal(getattr(frame, name), getattr(again, name)):
                yield f"another {name} when it is drawn again"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", action="store_true", help="draw frames; the rules alone by default")
    parser.add_argument("--pieces", type=int, default=PIECES)
    parser.add_argument("--minutes", type=float, help="begin no piece later than so many minutes after the start")
    parser.add_argument("--smoke", action="store_true", help="one piece of one river, without a table")
    parser.add_argument("--out", type=Path, help="the table; soak_steps.csv or soak_frames.csv here by default")
    given = parser.parse_args()
    amount, soak = (FRAMES, soak_frames) if given.frames else (STEPS, soak_steps)
    if given.smoke:
        faults = list(soak(0, 1, amount // 100))
        print("\n".join(faults) or "no fault")
        return 1 if faults else 0
    what = "frames" if given.frames else "steps"
    key = (*PIECE, *MADE_WITH[what])
    table = Pieces(given.out or HERE / f"soak_{what}.csv", key)
    made_with = versions_of(what)
    failed, clock = False, Clock(given.minutes)
    for piece in range(given.pieces):
        identity = (piece, RIVERS, amount, *made_with.values())
        row = table.row(*identity)
        if row is not None and row["faults"] == "0":
            continue
        if clock.is_over:
            break
        faults = list(soak(piece, RIVERS, amount))
        failed |= bool(faults)
        first = faults[0].replace(",", ";") if faults else ""
        table.add(dict(zip(key, identity, strict=True)) | {"faults": len(faults), "first": first})
        print(f"piece {piece}: {len(faults)} faults", *faults[:10], sep="\n  ", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
