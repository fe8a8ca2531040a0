"""A river of one's own: a line of x, y, water level and width, or a file, becomes a world, is drawn, and is flown."""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from thalweg.env import DoneReason, EnvConfig, RiverVectorEnv
from thalweg.world import World
from thalweg.world.map_image import draw

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--river", type=Path, help="a file instead: GeoJSON, Overpass JSON, GPX or KML")
parser.add_argument("--name", help="name of the river on the map")
parser.add_argument("--out", type=Path, default=Path("own_river.png"))
options = parser.parse_args()

if options.river is not None:
    world = World.from_file(options.river)
else:
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    radius = 45 + 8 * np.cos(3 * angle)
    line = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(40), 8 + 2 * np.sin(2 * angle)])
    world = replace(World.from_centerline(line, closed=True), name="Clover Brook")
if options.name is not None:
    world = replace(world, name=options.name)
draw(world, options.out)
shape = "a loop" if world.river.closed else "an open course"
print(f"{options.out}: {world.name}, {shape} of {world.river.length_m:.0f} m")

env = RiverVectorEnv([world], num_envs=4, config=EnvConfig(observation="none"))
env.reset(seed=0)
returns, running = np.zeros(4), np.ones(4, dtype=bool)
while running.any():
    _, reward, terminated, truncated, info = env.step(env.pilot_actions())
    returns += np.where(running, reward, 0.0)
    for index in np.flatnonzero(running & (terminated | truncated)):
        print(f"flight {index}: return {returns[index]:.2f}, {DoneReason(int(info['done_reason'][index])).label}")
    running &= ~(terminated | truncated)
