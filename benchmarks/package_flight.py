"""Copies a trained policy into the package, with the command that trained it and its scores.

    thalweg train --algorithm FOCOPS --level medium --steps 240000 --seed 0 --out runs/flight
    thalweg evaluate runs/flight --levels easy medium hard --out runs/flight/evaluation.csv
    python benchmarks/package_flight.py runs/flight

The policy becomes thalweg/bench/execute/flight.safetensors; the rows of its evaluation become flight.csv beside this
script.
"""

import shutil
import statistics
import sys
from dataclasses import replace
from pathlib import Path

import yaml

from thalweg.bench.evaluate.episodes import read_episodes
from thalweg.bench.execute.backend import PACKAGED_POLICY
from thalweg.train import load_policy

ROWS = Path(__file__).with_name("flight.csv")


def main() -> None:
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = Path(sys.argv[1])
    policy = load_policy(folder)
    run = yaml.safe_load((folder / "config.yaml").read_text())["run"]
    level = policy.about.context["level"]
    command = (
        f"thalweg train --algorithm {run['algorithm']} --level {level.lower()} --steps {run['steps']}"
        f" --seed {run['seed']} --out runs/{folder.name}"
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
    policy.about = replace(policy.about, context={**policy.about.context, "command": command, "scores": scores})
    policy.save(PACKAGED_POLICY)
    shutil.copyfile(folder / "evaluation.csv", ROWS)
    print(command)
    for name, score in scores.items():
        print(f"{name}: {score}")


if __name__ == "__main__":
    main()
