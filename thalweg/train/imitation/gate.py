"""The gate of a teacher: nothing is learnt from one that can't fly the rivers itself."""

from collections.abc import Callable, Sequence

import numpy as np

from thalweg.algos.imitation.config import Teacher
from thalweg.env import DoneReason, EnvConfig, RiverVectorEnv
from thalweg.env.rivers.bare_river import load_or_plan
from thalweg.env.task.reward_cost import FULL_COURSE_REWARD
from thalweg.train.errors import TrainingError
from thalweg.world import Level, Reach

BATCH = 50
"""Rivers that are flown together."""
GATE_SEED = 1_000_003
"""Seed of the starts, apart from those of training."""

Act = Callable[[RiverVectorEnv], np.ndarray]
"""A teacher: the actions [N, 4] to take in an environment's current state."""


def flown_by(teacher: Teacher) -> Act:
    """Return the teacher that is a pilot of this name."""
    return lambda env: env.pilot_actions(teacher)


def check_teacher(
    level: Level | Reach,
    seeds: Sequence[int],
    config: EnvConfig,
    act: Act,
    on_flown: Callable[[int], None] | None = None,
) -> None:
    """Fly one random start, of all that the rules allow, on each river; `on_flown` is told how many have ended.

    The seeds are those of the rivers of a level, or of starts on a real river, whose course does not depend on a seed.

    Raises `TrainingError` that names the first river, and the start, from which it does not reach the end; on a loop
    also if the return is below 10.
    """
    rules = config.with_options(observation="none", randomisation=None, critic_info=False)
    real = [level.build()] if isinstance(level, Reach) else []
    full = FULL_COURSE_REWARD if not real or real[0].river.closed else -np.inf
    for first in range(0, len(seeds), BATCH):
        chosen = list(seeds[first : first + BATCH])
        worlds = real or [load_or_plan(level, seed) for seed in chosen]  # pyright: ignore[reportArgumentType]
        env = RiverVectorEnv(worlds, len(chosen), rules)
        starts, _ = env.reset(seed=[GATE_SEED + seed for seed in chosen])
        returns, reasons = _flown(env, act)
        env.close()
        for seed, start, returned, reason in zip(chosen, starts, returns, reasons, strict=True):
            if reason != DoneReason.SUCCESS or returned < full - 1e-6:
                x, y, z, yaw = start
                river = level.name if real else f"{level.name}-{seed}"
                raise TrainingError(
                    f"the teacher fails its gate on {river} from x {x:.2f}, y {y:.2f}, z {z:.2f} m, yaw"
                    f" {yaw:.3f}: it returns {returned:.2f} of 10 and ends by {DoneReason(reason).label}; nothing is"
                    " learnt from it"
                )
        if on_flown is not None:
            on_flown(first + len(chosen))


def _flown(env: RiverVectorEnv, act: Act) -> tuple[np.ndarray, np.ndarray]:
    """Return the return [N] and the reason of the end [N] of one episode in each environment."""
    returns, reasons = np.zeros(env.num_envs), np.full(env.num_envs, int(DoneReason.RUNNING))
    while (reasons < 0).any():
        _, reward, _, _, info = env.step(act(env))
        running = reasons < 0
        returns[running] += reward[running]
        reasons[running] = info["done_reason"][running]
    return returns, reasons
