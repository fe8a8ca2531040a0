"""Where is a camera in flight? The poses of flights by the scripted pilot from random starts."""

import numpy as np

from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.world import World

FLIGHT_STEPS = 50
"""Steps of a flight: those of the original's recordings, so that frames can be held beside them."""


def pilot_poses(world: World, count: int, seed: int) -> np.ndarray:
    """Poses [count, 4] (x, y, z in metres, yaw in radians): flights of FLIGHT_STEPS steps, one after another.

    An episode that ends within a flight begins again at another random start.
    """
    flights = -(-count // FLIGHT_STEPS)
    env = RiverVectorEnv([world], flights, EnvConfig(observation="none"))
    pose, _ = env.reset(seed=seed)
    poses = np.empty((flights, FLIGHT_STEPS, 4))
    for step in range(FLIGHT_STEPS):
        poses[:, step] = pose
        pose, *_ = env.step(env.pilot_actions())
    return poses.reshape(-1, 4)[:count]
