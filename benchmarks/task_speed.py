"""Speed of the tasks where safety has a price: rules alone, and what their objects cost a frame.

    python benchmarks/task_speed.py            # writes task_speed.csv
    python benchmarks/task_speed.py --write    # also the table of docs/tasks.md

Sixteen environments in four rivers of Medium. Rules: steps of which nothing is drawn, by random actions, whose episodes
are short, and by the actions of the scripted pilot, which are chosen before. Frames: views of random starts and of
flights of that pilot, which flies low and past the objects, drawn by one thread with the objects of the task, which are
looked up first, and without them, in turns. All times are those of the processor that the process had, so that other
work does not count; the share that is lost is the median over the turns, and each time the least.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from page_sections import beside, replace_section, wrap

from thalweg.bench.csv_files import csv_text, read_csv
from thalweg.bench.report.table import frame, markdown
from thalweg.core.atomic_io import write_atomic
from thalweg.core.compute.threads import set_num_threads
from thalweg.core.machine import machine_info
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.tasks import TASKS
from thalweg.render import Renderer
from thalweg.world import World, load_or_build

HERE = Path(__file__).resolve().parent
TABLE, PAGE = HERE / "task_speed.csv", HERE.parent / "docs" / "tasks.md"
PLACES = ("starts", "flights")
COLUMNS = (
    "task", "random_steps_per_s", "pilot_steps_per_s",
    *(f"{place}_{what}" for place in PLACES for what in ("objects", "ms", "with_objects_ms", "lost_percent")),
    "processor", "load",
)  # fmt: skip
RIVERS, BATCH = 4, 16
APART, VIEWS = 20, 4
"""Steps between two views of a flight, and views of each."""
STEPS = 512
"""Steps of all environments in a turn of the rules."""

Clock = Callable[[], float]


def in_turns(works: Sequence[Callable[[], object]], turns: int, clock: Clock = time.process_time) -> np.ndarray:
    """Return the seconds [T, W] of each work in each turn; a first turn, which may compile, does not count."""
    seconds = np.empty((turns + 1, len(works)))
    for turn in range(turns + 1):
        for index, work in enumerate(works):
            begin = clock()
            work()
            seconds[turn, index] = clock() - begin
    return seconds[1:]


def lost_percent(seconds: np.ndarray) -> float:
    """Return how much slower the second of two works [T, 2] is than the first, in percent of its speed: the median over
    the turns."""
    return 100.0 * (1.0 - statistics.median(seconds[:, 0] / seconds[:, 1]))


def made(task: str, worlds: Sequence[World]) -> RiverVectorEnv:
    """Return environments of a task that draw nothing."""
    return RiverVectorEnv(worlds, BATCH, EnvConfig(observation="none", task=task))


def chosen_before(task: str, worlds: Sequence[World]) -> np.ndarray:
    """Return the actions [T, N, 4] of the scripted pilot in environments that are reset with the seed 0."""
    env, actions = made(task, worlds), []
    env.reset(seed=0)
    for _ in range(STEPS):
        actions.append(env.pilot_actions())
        env.step(actions[-1])
    return np.stack(actions)


def rules_speed(task: str, worlds: Sequence[World], actions: np.ndarray, turns: int) -> float:
    """Return steps in a second of the processor by actions [T, N, 4], from a reset with the seed 0 in each turn."""
    env = made(task, worlds)

    def work() -> None:
        for chosen in actions:
            env.step(chosen)

    seconds = in_turns([lambda: env.reset(seed=0), work], turns)[:, 1]
    return actions.shape[0] * BATCH / statistics.median(seconds)


def frames_of(task: str, worlds: Sequence[World], place: str, turns: int) -> tuple[float, np.ndarray]:
    """Return the mean number of objects within their range, and seconds [T, 2] of a frame without and with them; place:
    one of `PLACES`."""
    env, renderer = made(task, worlds), Renderer(worlds)
    out = np.empty((BATCH, renderer.camera.height_px, renderer.camera.width_px, 4), np.uint8)
    env.reset(seed=0)
    counts, seconds = [], []
    for view in range(VIEWS):
        if place == "starts":
            env.reset(seed=BATCH * view)
        else:
            for _ in range(APART):
                env.step(env.pilot_actions())
        at = env.state.pose.copy(), env.world_index.copy(), env.state.time_s.copy(), out
        props = env.props()
        counts.append(0.0 if props is None else float((props[..., 0] > 0).sum(axis=1).mean()))
        without, with_objects = partial(renderer.render, *at), partial(_draw_objects, env, renderer, at)
        seconds.append(in_turns([without, with_objects], turns) / BATCH)
    return float(np.mean(counts)), np.mean(seconds, axis=0)


def _draw_objects(env: RiverVectorEnv, renderer: Any, at: tuple[Any, ...]) -> None:
    """Look the objects of the task up, and draw them too."""
    renderer.render(*at, props=env.props())


def measured(worlds: Sequence[World], turns: int) -> list[list[str]]:
    """Return a row for each task."""
    rows, machine, load = [], machine_info(), f"{os.getloadavg()[0]:.1f}"
    random = np.random.default_rng(0).integers(0, 3, (STEPS, BATCH, 4))
    for task, record in TASKS.items():
        actions = random, chosen_before(task, worlds)
        row = [task, *(f"{rules_speed(task, worlds, each, turns):.0f}" for each in actions)]
        for place in PLACES:
            if not record.props:
                row += [""] * 4
                continue
            count, seconds = frames_of(task, worlds, place, turns)
            times = [f"{1e3 * each:.3f}" for each in seconds.min(axis=0)]
            row += [f"{count:.1f}", *times, f"{lost_percent(seconds):.1f}"]
        rows.append([*row, f"{machine['cpu']} ({machine['cpu_type']})", load])
        print(*rows[-1], flush=True)
    return rows


def page_table(rows: Sequence[dict[str, str]]) -> str:
    """Return the table of the page."""
    lines = []
    for row in rows:
        line = [row["task"], f"{int(row['random_steps_per_s']):,}", f"{int(row['pilot_steps_per_s']):,}"]
        for place in PLACES:
            lost = row[f"{place}_lost_percent"]
            times = f"{row[f'{place}_ms']}, {row[f'{place}_with_objects_ms']}"
            line += [times, f"{lost} %"] if lost else ["", ""]
        lines.append(line)
    frames = [f"{name}: {what}" for name in PLACES for what in ("ms without, with", "lost")]
    names = ["task", "random steps/s", "pilot's steps/s", *frames]
    machine = wrap(f"One core of {rows[0]['processor']}, {beside(rows[0]['load'])}.")
    return f"{markdown(frame(names, lines))}\n{machine}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--turns", type=int, default=21)
    parser.add_argument("--write", action="store_true", help="write the table into the page")
    given = parser.parse_args()
    set_num_threads(1)
    worlds = [load_or_build("Medium", seed) for seed in range(RIVERS)]
    write_atomic(TABLE, csv_text(COLUMNS, measured(worlds, given.turns)))
    if given.write:
        section = page_table(read_csv(TABLE, COLUMNS))
        write_atomic(PAGE, replace_section(PAGE.read_text(encoding="utf-8"), "speed", section))


if __name__ == "__main__":
    main()
