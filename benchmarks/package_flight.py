"""Copies an imitated policy into the package, with the command that made it and its scores.

    thalweg imitate --out runs/student --steps 1600000
    thalweg evaluate runs/student --levels easy medium hard --unseen --episodes 100 --out runs/student/evaluation.csv
    python benchmarks/package_flight.py runs/student

A policy of image and mask becomes thalweg/bench/packaged/flight.safetensors, and one of the image alone
flight_rgb.safetensors beside it; the rows of the evaluation become flight.csv or flight_rgb.csv beside this script.
"""

import shutil
import statistics
import sys
from dataclasses import replace
from pathlib import Path

import yaml

from thalweg.bench.evaluate.episodes import read_episodes
from thalweg.bench.packaged import PACKAGED, PACKAGED_POLICIES, PACKAGED_RGB, PACKAGED_SEES
from thalweg.train import load_policy

NAMES = {PACKAGED_SEES: PACKAGED, "rgb": PACKAGED_RGB}
"""Names of packaged policies, by what they see."""


def main() -> None:
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = Path(sys.argv[1])
    policy = load_policy(folder)
    run = yaml.safe_load((folder / "config.yaml").read_text())["run"]
    context = policy.about.context
    if context["observation"] not in NAMES:
        sys.exit(f"{folder} sees {context['observation']}: packaged are policies of {' or '.join(NAMES)}")
    path = PACKAGED_POLICIES[NAMES[context["observation"]]]
    command = (
        f"thalweg imitate --out runs/{folder.name} --levels {' '.join(context['levels'])}"
        f" --world-seeds {' '.join(map(str, context['world_seeds']))} --observation {context['observation']}"
        f" --steps {run['steps']} --seed {run['seed']} --num-envs {run['num_envs']}"
    )
    episodes = read_episodes(folder / "evaluation.csv")
    scores = {}
    for name in dict.fromkeys(episode.level for episode in episodes):
        flown = [episode for episode in episodes if episode.level == name]
        scores[name] = {
            "episodes": len(flown),
            "return": round(statistics.mean(episode.return_ for episode in flown), 3),
            "cost": round(statistics.mean(episode.cost for episode in flown), 3),
            "success": round(statistics.mean(episode.success for episode in flown), 3),
        }
    policy.about = replace(policy.about, context={**context, "command": command, "scores": scores})
    policy.save(path)
    shutil.copyfile(folder / "evaluation.csv", Path(__file__).with_name(f"{path.stem}.csv"))
    print(command)
    for name, score in scores.items():
        print(f"{name}: {score}")


if __name__ == "__main__":
    main()
