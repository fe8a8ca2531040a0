"""Rivers and long random flights for the tests of tasks."""

from collections.abc import Iterator
from functools import cache

import numpy as np

from tests.env.handmade import canal, hairpin, ring
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.rivers.bare_river import load_or_plan
from thalweg.world import World, level_named

PRICED = ("Swimmers", "Nests", "RacingLine", "Portage")
N = 6


@cache
def rivers() -> dict[str, World]:
    """Rivers by name: made by hand, and of a level with islands and bridges."""
    island = [[30.0, 1.5, 3.0, 0.8, 0.2]]
    return {
        "ring": ring(level_m=np.linspace(0, 1, 96)),
        "hairpin": hairpin(),
        "canal": canal(width_m=8.0, islands=island),
        "Hard": load_or_plan(level_named("Hard"), 3),
    }


def made(task: str, world: World, count: int = N, mode: str = "SAME_STEP", **options) -> RiverVectorEnv:
    """Environments of a task that draw nothing."""
    config = EnvConfig(**{"observation": "none", "task": task, **options})
    return RiverVectorEnv(world, count, config, autoreset_mode=mode)


def erratic(env: RiverVectorEnv, rng: np.random.Generator) -> np.ndarray:
    """Actions [N, 4], mostly forward and level, so that flights last and go everywhere."""
    actions = rng.choice([0, 1, 2], (env.num_envs, 4), p=[0.3, 0.4, 0.3])
    actions[:, 0] = rng.choice([0, 1, 2], env.num_envs, p=[0.1, 0.8, 0.1])
    actions[:, 2] = rng.choice([0, 1, 2], env.num_envs, p=[0.5, 0.1, 0.4])
    if env.config.task_record.portage:
        world = env.worlds[0]
        at = np.searchsorted(world.river.arc_m, env.state.station) - 1
        x, y, _, yaw = env.state.pose.T
        angle = np.arctan2(world.river.position_m[at, 1] - y, world.river.position_m[at, 0] - x) - yaw
        turn = np.where(np.sin(angle) > 0.1, 0, np.where(np.sin(angle) < -0.1, 2, 1))
        actions[:, 1] = np.where(rng.random(env.num_envs) < 0.7, turn, actions[:, 1])
    else:
        guided = env.pilot_actions()
        guided[:, 2] = np.where(rng.random(env.num_envs) < 0.3, 2, guided[:, 2])
        actions = np.where(rng.random((env.num_envs, 1)) < 0.2, actions, guided)
    return actions


def flown(env: RiverVectorEnv, steps: int, seed: int = 0) -> Iterator[tuple[int, np.ndarray, dict, dict]]:
    """(row, action, what the step returned of that row, state before it) of every step of random flights."""
    rng = np.random.default_rng(seed)
    env.reset(seed=seed)
    for _ in range(steps):
        before = env.get_state()
        actions = erratic(env, rng)
        _, rewards, terminated, truncated, info = env.step(actions)
        for row in range(env.num_envs):
            told = {name: info[name][row] for name in ("cost", "costs", "pose", "done_reason", "progress")}
            told |= {"reward": rewards[row], "terminated": terminated[row], "truncated": truncated[row]}
            yield row, actions[row], told, {name: array[row] for name, array in before.items() if len(array) > row}
