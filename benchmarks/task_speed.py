"""Speed of the tasks where safety has a price, of weather and of boats: rules alone, and what objects cost a frame.

    python benchmarks/task_speed.py            # writes task_speed.csv
    python benchmarks/task_speed.py --write    # also the table of docs/tasks.md

Sixteen environments in four rivers of Medium. Rules: steps of which nothing is drawn, by random actions, whose episodes
are short, and by the actions of the scripted pilot, which are chosen before. Frames: views of random starts and of
flights of that pilot, which flies low and past the objects, drawn by one thread with the objects of the task, which are
looked up first, and without them, in turns. All times are those of the processor that the process had, so that other
work does not count; the time of a frame is the least of the turns, steps a second and the share that is lost are
medians over them. Everything is measured in several processes, of which the table has the medians: on an idle machine,
Nests lost 1.5 % in one process and 4.4 % in another.
"""

import argparse
import multiprocessing
import os
import statistics
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
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
from thalweg.env.physics.wind import Wind
from thalweg.env.tasks import TASKS
from thalweg.render import Renderer
from thalweg.world import World, load_or_build

HERE = Path(__file__).resolve().parent
TABLE, PAGE = HERE / "task_speed.csv", HERE.parent / "docs" / "tasks.md"
PLACES = ("starts", "flights")
FIGURES = {"random_steps_per_s": ".0f", "pilot_steps_per_s": ".0f"} | {
    f"{place}_{what}": form
    for place in PLACES
    for what, form in {"objects": ".1f", "ms": ".3f", "with_objects_ms": ".3f", "lost_percent": ".1f"}.items()
}
"""Formats of what is measured, by column."""
COLUMNS = ("task", *FIGURES, "processor", "load")
RIVERS, BATCH = 4, 16
APART, VIEWS = 20, 4
"""Steps between two views of a flight, and views of each."""
STEPS = 512
"""Steps of all environments in a turn of the rules."""

ENVIRONMENTS = {
    **{task: EnvConfig(observation="none", task=task) for task in TASKS},
    "River in wind": EnvConfig(observation="none", wind=Wind()),
    "River with inertia": EnvConfig(observation="none", action="continuous", dynamics="inertial"),
    "River of boats": EnvConfig(observation="none", vehicle="asv"),
    "River of boats in wind and current": EnvConfig(
        observation="none", vehicle="asv", wind=Wind((0.5, 1.5)), current_m_per_s=(0.2, 0.6)
    ),
}
"""Environments that draw nothing, by their names in the table."""

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


def made(name: str, worlds: Sequence[World]) -> RiverVectorEnv:
    """Return one of `ENVIRONMENTS` in some rivers."""
    return RiverVectorEnv(worlds, BATCH, ENVIRONMENTS[name])


def at_random(name: str, worlds: Sequence[World]) -> np.ndarray:
    """Return random actions [T, N, A]."""
    space = made(name, worlds).action_space
    space.seed(0)
    return np.stack([space.sample() for _ in range(STEPS)])


def chosen_before(name: str, worlds: Sequence[World]) -> np.ndarray:
    """Return the actions [T, N, A] of the scripted pilot in environments that are reset with the seed 0."""
    env, actions = made(name, worlds), []
    env.reset(seed=0)
    for _ in range(STEPS):
        actions.append(env.pilot_actions())
        env.step(actions[-1])
    return np.stack(actions)


def rules_speed(name: str, worlds: Sequence[World], actions: np.ndarray, turns: int) -> float:
    """Return steps in a second of the processor by actions [T, N, A], from a reset with the seed 0 in each turn."""
    env = made(name, worlds)

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


def figures(turns: int) -> dict[str, dict[str, float]]:
    """Return what is measured in this process of each environment, by column."""
    set_num_threads(1)
    worlds = [load_or_build("Medium", seed) for seed in range(RIVERS)]
    found: dict[str, dict[str, float]] = {}
    for name, config in ENVIRONMENTS.items():
        found[name] = {
            "random_steps_per_s": rules_speed(name, worlds, at_random(name, worlds), turns),
            "pilot_steps_per_s": rules_speed(name, worlds, chosen_before(name, worlds), turns),
        }
        for place in PLACES if config.task_record.props else ():
            count, seconds = frames_of(name, worlds, place, turns)
            without_ms, with_ms = 1e3 * seconds.min(axis=0)
            measured = count, without_ms, with_ms, lost_percent(seconds)
            names = [column for column in FIGURES if column.startswith(place)]
            found[name] |= dict(zip(names, map(float, measured), strict=True))
    return found


def rows_of(found: Sequence[dict[str, dict[str, float]]], processor: str, load: str) -> list[list[str]]:
    """Return the rows of the table: the medians of what several processes found."""
    rows = []
    for name in found[0]:
        medians = {column: statistics.median(each[name][column] for each in found) for column in found[0][name]}
        cells = [format(medians[column], form) if column in medians else "" for column, form in FIGURES.items()]
        rows.append([name, *cells, processor, load])
    return rows


def in_processes(processes: int, turns: int) -> list[dict[str, dict[str, float]]]:
    """Return what each of some processes finds, one after the other."""
    found = []
    for number in range(processes):
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as alone:
            found.append(alone.submit(figures, turns).result())
        print(f"process {number + 1} of {processes}:", found[-1], flush=True)
    return found


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
    parser.add_argument("--turns", type=int, default=11)
    parser.add_argument("--processes", type=int, default=7)
    parser.add_argument("--write", action="store_true", help="write the table into the page")
    given = parser.parse_args()
    machine, load = machine_info(), f"{os.getloadavg()[0]:.1f}"
    found = in_processes(given.processes, given.turns)
    write_atomic(TABLE, csv_text(COLUMNS, rows_of(found, f"{machine['cpu']} ({machine['cpu_type']})", load)))
    if given.write:
        section = page_table(read_csv(TABLE, COLUMNS))
        write_atomic(PAGE, replace_section(PAGE.read_text(encoding="utf-8"), "speed", section))


if __name__ == "__main__":
    main()
