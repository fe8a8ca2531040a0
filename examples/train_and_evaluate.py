"""FOCOPS learns on Medium from the codes of frames and is evaluated on Easy; few steps show how, not how well."""

import argparse
from pathlib import Path

from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, encoded_frames, evaluate
from thalweg.bench.results.statistics import summarise
from thalweg.train import TrainingError, load_policy
from thalweg.train.observations import check_policy_fits
from thalweg.train.river import RiverTraining, load_compatible_encoder

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--steps", type=int, default=8192)
parser.add_argument("--episodes", type=int, default=4)
parser.add_argument("--encoder", type=Path, default=None)
parser.add_argument("--out", type=Path, default=Path("runs/example"))
options = parser.parse_args()

encoder = load_compatible_encoder(options.encoder)
ground = RiverTraining("Medium", num_envs=16)
try:
    result = ground.train("FOCOPS", encoder, steps=options.steps, seed=0, folder=options.out)
except TrainingError as error:  # such as a folder with a run of another number of steps
    raise SystemExit(f"{error} --out names one.") from error
print(f"{result.episodes} episodes in {result.seconds:.0f} s")

policy = load_policy(options.out)
check_policy_fits(policy, encoder)
config = EvaluationConfig(episodes=options.episodes)
course = Course.of_level("Easy", config)
label = Label("FOCOPS", 0, "Easy")
rows = evaluate(policy, course, label, config, observe=encoded_frames(course.world, encoder))
cell = summarise(rows)
print(f"Easy: return {cell.return_mean:.2f} ± {cell.return_std:.2f}, cost {cell.cost_mean:.2f} ± {cell.cost_std:.2f}")
