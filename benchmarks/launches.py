"""Number of operations that a learner would launch on a GPU in each step, counted without having one.

    python benchmarks/launches.py

writes launches.csv: operations in one step of 64 environments together, with the default settings. Those of the
environment, its frames and the encoder are not included. An operation launches one kernel or a few. For more
environments, default settings scale with their number, so that a step of all of them takes as many operations.
Learners run on the simulated device of the tests. Rows are written as they are counted, in place of earlier ones, with
the version of their algorithm. `--write` counts nothing, but writes what they show into docs/devices.md.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
import torch
from page_sections import replace_section, wrap
from tables import of_versions, put, rows_of

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))  # the simulated device is part of the tests

from tests.devices.pretend import PRETEND, Device, pretended  # noqa: E402
from tests.devices.toy import TensorWalk  # noqa: E402
from thalweg.algos import ALGORITHMS  # noqa: E402
from thalweg.algos.interface import Task  # noqa: E402
from thalweg.algos.offpolicy.config import OffPolicyConfig  # noqa: E402
from thalweg.algos.onpolicy.config import OnPolicyConfig  # noqa: E402
from thalweg.algos.planning.config import PlanningConfig  # noqa: E402
from thalweg.algos.presets import REFERENCE_ENVS  # noqa: E402
from thalweg.core import versions  # noqa: E402
from thalweg.core.atomic_io import write_atomic  # noqa: E402
from thalweg.train.rollouts.tensor_collector import TensorCollector  # noqa: E402
from thalweg.train.trainer import Trainer  # noqa: E402

TABLE, PAGE, SECTION = HERE / "launches.csv", HERE.parent / "docs" / "devices.md", "launches"
KEY = ("algorithm", "environments")
COLUMNS = (*KEY, "version", "acting", "learning")
ACTIONS = gym.spaces.MultiDiscrete([3, 3, 3, 3])
OBSERVATION_SIZE = 16
"""Numbers in an observation, as many as in the code of a frame."""
STEPS = 2 * 2048
"""Steps of all environments together during which operations are counted: two rollouts of on-policy algorithms."""
KINDS = {
    "an on-policy algorithm": OnPolicyConfig,
    "an off-policy one": OffPolicyConfig,
    "a planner": PlanningConfig,
}
"""Kinds of algorithms in the sentence of the page."""


class UncountedWalk(TensorWalk):
    """A walk whose observations are as long as the code of a frame, and whose own operations are not counted."""

    def __init__(self, num_envs: int, device: Device) -> None:
        super().__init__(num_envs, ACTIONS, PRETEND)
        self.counting = device
        self.single_observation_space = gym.spaces.Box(-float("inf"), float("inf"), (OBSERVATION_SIZE,))

    def step(self, actions):
        before = self.counting.launched
        result = super().step(actions)
        self.counting.launched = before
        return result

    def observed(self) -> torch.Tensor:
        return super().observed().repeat(1, OBSERVATION_SIZE)[:, :OBSERVATION_SIZE]


def count_operations(name: str, num_envs: int, device: Device) -> tuple[float, float]:
    """Return the operations per step of all environments, for acting and for learning, after the random steps."""
    entry = ALGORITHMS[name]
    config = entry.configure({}, num_envs=num_envs)
    env = UncountedWalk(num_envs, device)
    collector = TensorCollector(env, config.frame_stack, 1)
    learner = entry.make(config, Task(collector.obs_size, ACTIONS, num_envs, 0, {}, PRETEND))
    scale = max(num_envs // REFERENCE_ENVS, 1)
    begin = getattr(config, "random_steps", 0)
    trainer = Trainer(collector, learner, begin + STEPS * scale, seed=0, threads=1)
    trainer.start()
    acting = learning = steps = 0
    while not trainer.done:
        before = device.launched
        trainer.step()
        after = device.launched
        if trainer.ready:
            trainer.update()
        if trainer.statistics.steps > begin:
            acting, learning, steps = acting + after - before, learning + device.launched - after, steps + 1
    return acting / steps, learning / steps


def sentence(rows: Sequence[Mapping[str, str]]) -> str:
    """Return what the page says of the rows of today's versions, for as many environments as defaults are made for, and
    which algorithms have none."""
    told, lacking = [], []
    for words, kind in KINDS.items():
        names = [name for name, entry in ALGORITHMS.items() if issubclass(entry.config, kind)]
        found = {name: of_versions(rows, row_key(name, REFERENCE_ENVS)) for name in names}
        lacking += [name for name in names if not found[name]]
        if own := [row for same in found.values() for row in same]:
            acting, learning = (span([float(row[what]) for row in own]) for what in ("acting", "learning"))
            told.append(f"{words} needs {acting} to act and {learning} to learn")
    text = f"For {REFERENCE_ENVS} environments, {', '.join(told)}." if told else ""
    return wrap(text + (f" Not counted in today's version: {', '.join(lacking)}." if lacking else ""))


def span(counts: Sequence[float]) -> str:
    """Return the least and the greatest of some numbers, rounded."""
    least, most = f"{min(counts):,.0f}", f"{max(counts):,.0f}"
    return least if least == most else f"{least} to {most}"


def row_key(name: str, num_envs: int) -> dict[str, Any]:
    """Return what identifies a row of today's version of an algorithm."""
    return {"algorithm": name, "environments": num_envs, "version": versions.ALGORITHMS[name]}


def place_of(row: Mapping[str, str]) -> tuple[int, int]:
    """Return the place of a row in the table: in the order of the registry, then by environments."""
    return list(ALGORITHMS).index(row["algorithm"]), int(row["environments"])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=ALGORITHMS, default=list(ALGORITHMS), help="algorithms to count")
    parser.add_argument("--num-envs", nargs="+", type=int, default=[REFERENCE_ENVS], help="numbers of environments")
    parser.add_argument("--out", type=Path, default=TABLE, help="output file")
    parser.add_argument("--write", action="store_true", help="count nothing, but write the sentence of the page")
    chosen = parser.parse_args()
    if chosen.write:
        text = sentence(rows_of(chosen.out, COLUMNS))
        write_atomic(PAGE, replace_section(PAGE.read_text(encoding="utf-8"), SECTION, text))
        return 0
    for name in chosen.only:
        for num_envs in chosen.num_envs:
            with pytest.MonkeyPatch.context() as patch, pretended(patch) as device:
                counts = count_operations(name, num_envs, device)
            found = dict(zip(COLUMNS[-2:], (f"{count:.1f}" for count in counts), strict=True))
            put(chosen.out, COLUMNS, [row := row_key(name, num_envs) | found], KEY, place_of)
            print(*row.values(), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
