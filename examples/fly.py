"""The scripted pilot, which knows the map, flies the Medium river; what it saw is saved as one picture."""

import argparse
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import thalweg  # registers the environments  # noqa: F401
from thalweg.bench.pictures.contact_sheet import contact_sheet
from thalweg.cli.options import check_file
from thalweg.env import DoneReason

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--steps", type=int, default=500)
parser.add_argument("--out", type=Path, default=Path("flight.png"))
options = parser.parse_args()
check_file("--out", options.out, ".png")

env = gymnasium.make("thalweg/Medium-v0")
river: Any = env.unwrapped
frame, info = env.reset(seed=0)
frames = [frame]
total, ended = 0.0, False
while not ended and len(frames) <= options.steps:
    frame, reward, terminated, truncated, info = env.step(river.pilot_action())
    frames.append(frame)
    total += float(reward)
    ended = terminated or truncated
print(f"{len(frames) - 1} steps, return {total:.2f}, cost {info['cost']}, {DoneReason(int(info['done_reason'])).label}")
contact_sheet(np.stack(frames)[:: max(1, len(frames) // 16)][:16]).save(options.out)
print(options.out)
