"""Short flights for the tests: actions by name, and one episode flown to its end."""

import numpy as np

from thalweg.env import DoneReason, EnvConfig, RiverVectorEnv
from thalweg.world.record import World

HOVER = (1, 1, 1, 1)
UP = (0, 1, 1, 1)
DOWN = (2, 1, 1, 1)
TURN_LEFT = (1, 0, 1, 1)
TURN_RIGHT = (1, 2, 1, 1)
FORWARD = (1, 1, 0, 1)
BACKWARD = (1, 1, 2, 1)
LEFT = (1, 1, 1, 0)
RIGHT = (1, 1, 1, 2)


def at(world: World, pose, count: int = 1, mode: str = "DISABLED", **options) -> RiverVectorEnv:
    """N environments in a world that draw nothing, begun at a pose [4]."""
    config = EnvConfig(**{"observation": "none", **options})
    env = RiverVectorEnv(world, count, config, autoreset_mode=mode)
    env.reset(seed=0, options={"pose": np.asarray(pose, dtype=float)})
    return env


def step(env: RiverVectorEnv, action) -> tuple[float, float, DoneReason, dict]:
    """(reward, cost, done reason, info) of one action in the first environment of `env`."""
    _, rewards, _, _, info = env.step(np.tile(np.asarray(action), (env.num_envs, 1)))
    return float(rewards[0]), float(info["cost"][0]), DoneReason(int(info["done_reason"][0])), info


def fly(env: RiverVectorEnv, actions) -> list[tuple[float, float, DoneReason]]:
    """(reward, cost, done reason) of each action, until the episode ends."""
    flown = []
    for action in actions:
        reward, cost, reason, _ = step(env, action)
        flown.append((reward, cost, reason))
        if reason is not DoneReason.RUNNING:
            break
    return flown
