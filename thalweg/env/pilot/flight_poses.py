"""Poses of flights by the scripted pilot from random starts, as a source of frames."""

import numpy as np

from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.config import Vehicle
from thalweg.world import World

FLIGHT_STEPS = 50
"""Steps of a flight: as in the recordings of the original, so that frames can be compared with them."""


def pilot_poses(world: World, count: int, seed: int, vehicle: Vehicle = "uav") -> np.ndarray:
    """Return poses [count, 4] (x, y, z in metres, yaw in radians) of consecutive flights of FLIGHT_STEPS steps.

    If an episode ends within a flight, the flight continues from another random start.
    """
    flights = -(-count // FLIGHT_STEPS)
    env = RiverVectorEnv([world], flights, EnvConfig(observation="none", vehicle=vehicle))
    pose, _ = env.reset(seed=seed)
    poses = np.empty((flights, FLIGHT_STEPS, 4))
    for step in range(FLIGHT_STEPS):
        poses[:, step] = pose
        pose, *_ = env.step(env.pilot_actions())
    return poses.reshape(-1, 4)[:count]
