"""A tiny suite on a real river, seen through the real encoder; as a program it does it, or dies in the midst of it:
`python -m tests.bench.river_suite FOLDER DIE_AT_UPDATE`.
"""

import os
import signal
import sys
from pathlib import Path

from thalweg.bench.execute.runner import run_suite
from thalweg.bench.suite.arms import Arm
from thalweg.bench.suite.config import Suite
from thalweg.train.trainer import Trainer

SUITE = Suite(
    "tiny",
    (Arm("FOCOPS", settings={"steps_per_update": 128}, seeds=(0,), steps=512),),
    train_level="Easy",
    test_levels=("Easy",),
    episodes=2,
    num_envs=8,
    baselines=(),
    packaged=False,
)


def die_at(update: int) -> None:
    """Make this process kill itself, without a chance to clean up, when a run comes to that update."""
    learn = Trainer.update

    def update_or_die(trainer: Trainer) -> dict[str, float]:
        if trainer.updates + 1 == update:
            os.kill(os.getpid(), signal.SIGKILL)
        return learn(trainer)

    Trainer.update = update_or_die  # pyright: ignore[reportAttributeAccessIssue]


if __name__ == "__main__":
    die_at(int(sys.argv[2]))
    run_suite(SUITE, Path(sys.argv[1]))
