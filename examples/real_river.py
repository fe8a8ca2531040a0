"""A real river: the pilot flies the Cam through Cambridge, built from a GeoJSON file of its centre line."""

import argparse
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import thalweg  # registers the environments
from thalweg.bench.pictures.contact_sheet import contact_sheet
from thalweg.env import DoneReason
from thalweg.world import World
from thalweg.world.map_image import draw

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument(
    "--file", type=Path, default=Path(thalweg.__file__).parent / "world" / "real" / "rivers" / "cam.geojson"
)
parser.add_argument("--start-m", type=float, default=0.0)
parser.add_argument("--length-m", type=float, default=None)
parser.add_argument("--out", type=Path, default=Path("real_river"))
options = parser.parse_args()

world = World.from_file(options.file, start_m=options.start_m, length_m=options.length_m)
river = world.river
draw(world, options.out.with_suffix(".map.png"))
print(f"{world.name}: {river.length_m:.0f} m, {river.width_m.min():.0f} to {river.width_m.max():.0f} m wide")

env: Any = gymnasium.make_vec("thalweg/Medium-v0", num_envs=1, worlds=world)  # the id's level has no part in it
(x, y), (east, north) = river.position_m[0], river.tangent[0]
frames, info = env.reset(seed=0, options={"pose": [[x, y, river.level_m[0] + 4.0, math.atan2(north, east)]]})
seen, total, reason = [frames[0]], 0.0, DoneReason.RUNNING
while reason is DoneReason.RUNNING:
    frames, reward, _, _, info = env.step(env.unwrapped.pilot_actions())
    total, reason = total + reward[0], DoneReason(int(info["done_reason"][0]))
    seen.append(frames[0])
print(f"{len(seen) - 1} steps, return {total:.2f}, {reason.label}")
contact_sheet(np.stack(seen[:-1])[:: max(1, len(seen) // 16)][:16]).save(options.out.with_suffix(".png"))
print(options.out.with_suffix(".map.png"), options.out.with_suffix(".png"))
