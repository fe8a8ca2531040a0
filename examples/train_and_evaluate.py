"""FOCOPS learns on Medium from the codes of frames and is evaluated on Easy; few steps show how, not how well."""

import argparse
from pathlib import Path

from thalweg.bench.evaluation import Course, EvaluationConfig, Label, evaluate, through_encoder
from thalweg.bench.statistics import summarise
from thalweg.encoder import load_encoder
from thalweg.env import RiverVectorEnv
from thalweg.train import LatentVectorEnv, load_policy, run
from thalweg.world import load_or_build

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--steps", type=int, default=8192)
parser.add_argument("--episodes", type=int, default=4)
parser.add_argument("--encoder", type=Path, default=None)
parser.add_argument("--out", type=Path, default=Path("runs/example"))
options = parser.parse_args()

encoder = load_encoder(options.encoder)
env = LatentVectorEnv(RiverVectorEnv([load_or_build("Medium")], num_envs=16), encoder)
result = run("FOCOPS", env, steps=options.steps, seed=0, folder=options.out, progress=True)
print(f"{result.episodes} episodes in {result.seconds:.0f} s")

config = EvaluationConfig(episodes=options.episodes)
course = Course.of_level("Easy", config)
label = Label("FOCOPS", 0, "Easy")
rows = evaluate(load_policy(options.out), course, label, config, look=through_encoder(course.world, encoder))
cell = summarise(rows)
print(f"Easy: return {cell.return_mean:.2f} ± {cell.return_std:.2f}, cost {cell.cost_mean:.2f} ± {cell.cost_std:.2f}")
