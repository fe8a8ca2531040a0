"""Number of operations that a learner would launch on a GPU in each step, counted without having one.

    python benchmarks/launches.py

writes launches.csv: operations in one step of 64 environments together, with the default settings. Those of the
environment, its frames and the encoder are not included. An operation launches one kernel or a few. For more
environments, default settings scale with their number, so that a step of all of them takes as many operations.
Learners run on the simulated device of the tests. Rows are written as they are counted, in place of earlier ones.
"""

import argparse
import sys
from pathlib import Path

import gymnasium as gym
import pytest
import torch

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))  # the simulated device is part of the tests

from tests.devices.pretend import PRETEND, Device, pretended  # noqa: E402
from tests.devices.toy import TensorWalk  # noqa: E402
from thalweg.algos import ALGORITHMS  # noqa: E402
from thalweg.algos.interface import Task  # noqa: E402
from thalweg.algos.presets import REFERENCE_ENVS  # noqa: E402
from thalweg.bench.csv_files import csv_text, read_csv  # noqa: E402
from thalweg.core.atomic_io import write_atomic  # noqa: E402
from thalweg.train.rollouts.tensor_collector import TensorCollector  # noqa: E402
from thalweg.train.trainer import Trainer  # noqa: E402

TABLE = HERE / "launches.csv"
COLUMNS = ("algorithm", "environments", "acting", "learning")
ACTIONS = gym.spaces.MultiDiscrete([3, 3, 3, 3])
OBSERVATION_SIZE = 16
"""Numbers in an observation, as many as in the code of a frame."""
STEPS = 2 * 2048
"""Steps of all environments together during which operations are counted: two rollouts of on-policy algorithms."""


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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=ALGORITHMS, default=list(ALGORITHMS), help="algorithms to count")
    parser.add_argument("--num-envs", nargs="+", type=int, default=[REFERENCE_ENVS], help="numbers of environments")
    parser.add_argument("--out", type=Path, default=TABLE, help="output file")
    chosen = parser.parse_args()
    before = read_csv(chosen.out, COLUMNS) if chosen.out.is_file() else []
    rows = {(row["algorithm"], row["environments"]): [row[name] for name in COLUMNS] for row in before}
    for name in chosen.only:
        for num_envs in chosen.num_envs:
            with pytest.MonkeyPatch.context() as patch, pretended(patch) as device:
                acting, learning = count_operations(name, num_envs, device)
            rows[name, str(num_envs)] = row = [name, str(num_envs), f"{acting:.1f}", f"{learning:.1f}"]
            print(*row, flush=True)
            write_atomic(chosen.out, csv_text(COLUMNS, rows.values()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
