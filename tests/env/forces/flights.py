"""Flights under forces over wide water, where nothing ends them, and of environments that share random numbers."""

from typing import Any

import numpy as np

from tests.env.handmade import canal
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.world.record import World

MIDDLE = np.array([500.0, 0.0, 8.0, 0.0])
"""A pose in the middle of `wide_water`."""
STILL = np.array([[0.0, 0.0, 0.0, 0.0]], np.float32)
FORWARD = np.array([[0.0, 0.0, 1.0, 0.0]], np.float32)


def wide_water(**options: Any) -> World:
    """A straight open course of 1000 m along x, and as wide."""
    return canal(1000.0, 10.0, **{"width_m": 1000.0, **options})


def begun(world: World, pose: np.ndarray = MIDDLE, **options: Any) -> RiverVectorEnv:
    """One environment at a pose, without a limit of time, whose actions are continuous."""
    config = EnvConfig(observation="none", action="continuous", max_idle_steps=10_000, max_steps=10_000, **options)
    env = RiverVectorEnv(world, 1, config)
    env.reset(seed=0, options={"pose": pose})
    return env


def flown(env: RiverVectorEnv, action: np.ndarray, steps: int) -> np.ndarray:
    """Poses [steps, 4] after each step of one environment that repeats an action [1, 4]."""
    return np.array([env.step(action)[0][0] for _ in range(steps)])
