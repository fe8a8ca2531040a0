"""How often would a learner ask a GPU for something? Operations that compute, counted without having one.

    python benchmarks/launches.py

writes launches.csv: how many there are in a step of 64 environments at once, with the defaults, beside those of the
environment, its frames and the encoder. Each is a kernel that is launched, or a few. Of more environments settings
follow their number, so that a step of all of them takes as many. Learners work on a device that tests pretend.
"""

import argparse
import csv
import sys
from pathlib import Path

import gymnasium as gym
import pytest
import torch

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))  # the device stands among the tests

from tests.devices.pretend import PRETEND, Device, pretended  # noqa: E402
from tests.devices.toy import TensorWalk  # noqa: E402
from thalweg.algos import ALGORITHMS  # noqa: E402
from thalweg.algos.interface import Task  # noqa: E402
from thalweg.algos.presets import REFERENCE_ENVS  # noqa: E402
from thalweg.train.rollouts.tensor_collector import TensorCollector  # noqa: E402
from thalweg.train.trainer import Trainer  # noqa: E402

TABLE = HERE / "launches.csv"
COLUMNS = ("algorithm", "environments", "acting", "learning")
ACTIONS = gym.spaces.MultiDiscrete([3, 3, 3, 3])
SIGHT = 16
"""Numbers of an observation: those of a frame's code."""
STEPS = 2 * 2048
"""That are counted: of all environments together, two rounds of an on-policy algorithm."""


class Sightless(TensorWalk):
    """A walk whose observations are as long as a frame's code, and whose own operations don't count."""

    def __init__(self, num_envs: int, device: Device) -> None:
        super().__init__(num_envs, ACTIONS, PRETEND)
        self.counting = device
        self.single_observation_space = gym.spaces.Box(-float("inf"), float("inf"), (SIGHT,))

    def step(self, actions):
        before = self.counting.launched
        found = super().step(actions)
        self.counting.launched = before
        return found

    def observed(self) -> torch.Tensor:
        return super().observed().repeat(1, SIGHT)[:, :SIGHT]


def counted(name: str, num_envs: int, device: Device) -> tuple[float, float]:
    """Operations of a step of all environments, for acting and for learning, once actions are no longer random."""
    entry = ALGORITHMS[name]
    config = entry.configure({}, num_envs=num_envs)
    env = Sightless(num_envs, device)
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
    parser.add_argument("--only", nargs="+", choices=ALGORITHMS, default=list(ALGORITHMS), help="algorithms")
    parser.add_argument("--num-envs", nargs="+", type=int, default=[REFERENCE_ENVS], help="environments")
    parser.add_argument("--out", type=Path, default=TABLE, help="where the table is written")
    chosen = parser.parse_args()
    rows = []
    for name in chosen.only:
        for num_envs in chosen.num_envs:
            with pytest.MonkeyPatch.context() as patch, pretended(patch) as device:
                acting, learning = counted(name, num_envs, device)
            rows.append((name, num_envs, f"{acting:.1f}", f"{learning:.1f}"))
            print(*rows[-1], flush=True)
    with chosen.out.open("w", newline="") as text:
        csv.writer(text, lineterminator="\n").writerows([COLUMNS, *rows])
    return 0


if __name__ == "__main__":
    sys.exit(main())
