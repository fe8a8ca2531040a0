"""Copies an imitated policy into the package, with the command that made it and its scores.

    thalweg imitate --out runs/student --steps 1600000
    thalweg evaluate runs/student --levels easy medium hard --unseen --episodes 100 --out runs/student/evaluation.csv
    python benchmarks/package_flight.py runs/student
    python benchmarks/package_flight.py runs/last runs/first            # a student that began with that of runs/first

A policy of image and mask becomes thalweg/bench/packaged/flight.safetensors, and one of the image alone
flight_rgb.safetensors beside it; the rows of the evaluation become flight.csv or flight_rgb.csv beside this script.
"""

import shutil
import statistics
import sys
from dataclasses import replace
from pathlib import Path

import yaml

from thalweg.algos.imitation.config import ImitationConfig
from thalweg.bench.evaluate.episodes import read_episodes
from thalweg.bench.packaged import PACKAGED, PACKAGED_POLICIES, PACKAGED_RGB, PACKAGED_SEES
from thalweg.core.cache import file_hash
from thalweg.core.config import to_plain
from thalweg.train import load_policy
from thalweg.train.run_in_folder import policy_file

NAMES = {PACKAGED_SEES: PACKAGED, "rgb": PACKAGED_RGB}
"""Names of packaged policies, by what they see."""


def command_of(folder: Path, before: Path | None) -> str:
    """Return the command that trained the student of a folder, and before it that of the student it began with.

    Exits if the folder `before` has another policy than the one that it began with.
    """
    run = yaml.safe_load((folder / "config.yaml").read_text())["run"]
    begun = run.get("begin_with", {}).get("content")
    if begun != (None if before is None else file_hash(policy_file(before))):
        wanted = "give no second folder" if begun is None else f"give the folder of that policy, not {before}"
        sys.exit(f"{folder} began with {begun or 'no policy'}: {wanted}")
    usual = to_plain(ImitationConfig(observation=run["config"]["observation"]))
    settings = [f"{name}={value}" for name, value in run["config"].items() if value != usual[name]]
    words = (
        f"thalweg imitate --out runs/{folder.name} --levels {' '.join(run['context']['levels'])}"
        f" --world-seeds {' '.join(map(str, run['context']['world_seeds']))}"
        f" --observation {run['config']['observation']}"
        f" --steps {run['steps']} --seed {run['seed']} --num-envs {run['num_envs']}"
    )
    if settings:
        words += f" --set {' '.join(settings)}"
    return words if before is None else f"{command_of(before, None)} && {words} --begin-with runs/{before.name}"


def main() -> None:
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    folder = Path(sys.argv[1])
    policy = load_policy(folder)
    context = policy.about.context
    if context["observation"] not in NAMES:
        sys.exit(f"{folder} sees {context['observation']}: packaged are policies of {' or '.join(NAMES)}")
    path = PACKAGED_POLICIES[NAMES[context["observation"]]]
    command = command_of(folder, Path(sys.argv[2]) if len(sys.argv) == 3 else None)
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
