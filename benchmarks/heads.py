"""Comparison of two heads of students: one over all joint moves, and one for each branch of the action, the usual.

    python benchmarks/heads.py                  # trains and measures all that has no row yet
    python benchmarks/heads.py --only joint     # one of the heads
    python benchmarks/heads.py --write          # the table of docs/imitation-findings.md

Students differ in the last layer of their policy only: 54 logits of moves, or 12 of options, of which a move's four are
added. Both learn by the same loss, with the same seeds, on 16 rivers of each level. A row of heads.csv is appended as a
student is measured: on flights of its own on unseen rivers, and on states that are the same for all, from flights of
the teacher with a fifth of random moves on other unseen rivers. Of these, `regret` is how much less the student's most
probable move is worth than the best one, in segments of progress, `fatal` the share of them that are as bad as can be,
and `cross_entropy` that of its probabilities. A student that has a row is skipped, and training resumes in `--runs`.
"""

import argparse
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from any_river import LEVELS
from joint_head import JointImitation
from ladder_arms import FIRST_RIVER, SEEDS
from page_sections import replace_section
from river_flights import figures_of, fly
from safetensors.numpy import load_file
from tables import append
from torch import Tensor

from thalweg.algos.common.state import load_module
from thalweg.algos.imitation.config import ImitationConfig
from thalweg.algos.imitation.student import ALGORITHM, Student
from thalweg.algos.imitation.targets import cross_entropy, regrets, soft_targets
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.policy_file import tensors_of
from thalweg.bench.csv_files import read_csv
from thalweg.bench.evaluate.course import UNSEEN, Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.results.inference import Estimate, t_interval
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.spaces import action_space
from thalweg.render.records.randomisation import Randomisation
from thalweg.train.folder.run_record import POLICY
from thalweg.train.imitation.flights import Flights
from thalweg.train.imitation.imitate import Imitation
from thalweg.world import level_named

HERE = Path(__file__).resolve().parent
TABLE = HERE / "heads.csv"
PAGE, SECTION = HERE.parent / "docs" / "imitation-findings.md", "heads"
JOINT, BRANCHES = "joint", "branches"
STEPS, RIVERS = 100_000, 16
"""Steps of training, on so many rivers of each level."""
EPISODES = 100
"""Flights on unseen rivers of each level that is flown."""
FLOWN = ("Medium", "Hard")
OTHERS = range(UNSEEN + 500, UNSEEN + 516)
"""Seeds of the rivers of the common states."""
COMMON_SEQUENCES, ENVS, NOISE = 16, 32, 0.2
"""Sequences of common states in each of so many environments, and the share of random moves in them."""
CONTEXT = {"observation": ImitationConfig().observation}
"""What a student's policy file says of its training, as far as flights need it."""
MADE_WITH = ("imitation", "render", "rules", "world", "evaluation")
KEY = ("head", "seed", "steps", "rivers", "episodes", *MADE_WITH)
RETURNS = tuple(f"{name}_{level}" for level in FLOWN for name in ("return", "violations"))
COMMON = ("states", "cross_entropy", "regret", "fatal")
COLUMNS = (*KEY, *RETURNS, *COMMON)
IMITATIONS: dict[str, type[Imitation]] = {BRANCHES: Imitation, JOINT: JointImitation}


def common_states(student: Student) -> dict[str, str]:
    """Return `COMMON` of a student on the common states, through which the same moves lead whatever it would do."""
    rivers = RiverList.of_levels([(level_named(level), OTHERS) for level in LEVELS], None)
    rules = EnvConfig(observation=student.config.observation, randomisation=Randomisation())
    env = RiverVectorEnv(rivers, ENVS, rules)
    cross, regret = [], []
    try:
        flights = Flights(env, student, seed=0)
        flights.reset(list(range(ENVS)))
        for _ in range(COMMON_SEQUENCES):
            flights.begin()
            for _ in range(student.config.sequence):
                images, _, terminated, truncated, _ = env.step(flights.act(1.0, NOISE))
                flights.arrive(images, terminated | truncated)
            entropy, lost = judged(student, flights)
            cross.append(entropy)
            regret.append(lost)
    finally:
        env.close()
    missed = torch.cat(regret)
    fatal = (missed >= student.config.worst_regret).float().mean()
    figures = torch.stack(cross).mean(), missed.mean(), fatal
    return {"states": str(len(missed))} | {
        name: f"{float(value):.4f}" for name, value in zip(COMMON[1:], figures, strict=True)
    }


@torch.inference_mode()
def judged(student: Student, flights: Flights) -> tuple[Tensor, Tensor]:
    """Return the cross-entropy of the noted steps, and the regret [B] of the most probable move in each."""
    lesson = flights.lesson(flights.sequences())
    every = torch.arange(lesson.rows.shape[1])
    log_probs = student.log_probs(student.policy.actor.parameters_of(student.features(lesson, every)))
    regret = regrets(lesson.worths.flatten(0, 1), student.config.worst_regret)
    chosen = regret.gather(1, log_probs.argmax(-1, keepdim=True))[:, 0]
    return cross_entropy(soft_targets(regret, student.config.temperature), log_probs), chosen


@dataclass(frozen=True)
class Trial:
    """A student with one of the heads."""

    head: str
    seed: int
    steps: int
    episodes: int

    @property
    def key(self) -> tuple[str, ...]:
        """Values of `KEY`."""
        made_with = [str(getattr(versions, name.upper())) for name in MADE_WITH]
        return self.head, str(self.seed), str(self.steps), str(RIVERS), str(self.episodes), *made_with

    @property
    def folder(self) -> str:
        """Name of the folder of its run, whichever flights follow."""
        identity = dict(zip(KEY, self.key, strict=True))
        return "-".join(value for name, value in identity.items() if name not in ("episodes", "evaluation"))

    def measure(self, runs: Path) -> dict[str, str]:
        """Train the student, or resume, and measure it; returns its row."""
        seeds = range(FIRST_RIVER, FIRST_RIVER + RIVERS)
        imitation = IMITATIONS[self.head](runs / self.folder, self.steps, self.seed, LEVELS, seeds)
        imitation.run(progress=True)
        student = trained(imitation)
        row = dict(zip(KEY, self.key, strict=True)) | common_states(student)
        config = EvaluationConfig(self.episodes, deterministic=True)
        for level in FLOWN:
            courses = Course.of_seeds(level, range(UNSEEN, UNSEEN + self.episodes), config)
            one_each = (course.those([index]) for index, course in enumerate(courses))
            figures = figures_of(fly(student.policy, one_each, Label(ALGORITHM, self.seed, level), config))
            row |= {f"{name}_{level}": figures[name] for name in ("return", "violations")}
        return row


def trained(imitation: Imitation) -> Student:
    """Return the student of a finished run, as its policy's file has it."""
    student = imitation.new_student(ImitationConfig(), actions_of(action_space("multidiscrete")), CONTEXT)
    load_module(student.policy.actor, tensors_of(load_file(imitation.folder / POLICY), "actor"))
    return student


def table(rows: Iterable[Mapping[str, str]]) -> str:
    """Return the table of the page: a line for each head."""
    lines = []
    for head in IMITATIONS:
        mine = [row for row in rows if row["head"] == head]
        if mine:
            shown = {BRANCHES: "one for each branch", JOINT: "over joint moves"}[head]
            lines.append([shown, str(len(mine)), *(estimate(mine, name) for name in (*RETURNS, *COMMON[1:]))])
    heading = ["head", "seeds", *(name.replace("_", ", ") for name in RETURNS)]
    return markdown(frame([*heading, *(name.replace("_", "-") for name in COMMON[1:])], lines))


def estimate(rows: Sequence[Mapping[str, str]], name: str) -> str:
    """Return the mean of a column with its interval over seeds; shares in percent."""
    is_share = name.startswith("violations") or name == "fatal"
    digits = 1 if name.startswith("violations") else 2 if is_share or name.startswith("return") else 4
    per_seed = (100.0 if is_share else 1.0) * np.array([float(row[name]) for row in rows])
    found: Estimate = t_interval(float(per_seed.mean()), per_seed)
    unit = " %" if is_share else ""
    low = "" if np.isnan(found.low) else f" [{max(found.low, 0.0):.{digits}f}, {found.high:.{digits}f}]"
    return f"{found.value:.{digits}f}{unit}{low}"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=list(IMITATIONS), default=list(IMITATIONS), help="heads")
    parser.add_argument("--steps", type=int, default=STEPS, help="steps of training")
    parser.add_argument("--episodes", type=int, default=EPISODES, help="flights on each level")
    parser.add_argument("--runs", type=Path, default=HERE.parent / "runs" / "heads", help="folder of the runs")
    parser.add_argument("--out", type=Path, default=TABLE, help="the table")
    parser.add_argument("--write", action="store_true", help="train and fly nothing, but write the page")
    given = parser.parse_args(arguments)
    if given.steps < 1 or given.episodes < 2:
        parser.error("--steps must be at least 1, --episodes at least 2")
    trials = [Trial(head, seed, given.steps, given.episodes) for seed in SEEDS for head in given.only]
    rows = read_csv(given.out, COLUMNS) if given.out.is_file() else []
    found = {tuple(row[name] for name in KEY): row for row in rows}
    if given.write:
        today = [found[trial.key] for trial in trials if trial.key in found]
        text = table(today) if today else "Nothing was measured with today's versions.\n"
        write_atomic(PAGE, replace_section(PAGE.read_text(encoding="utf-8"), SECTION, text))
        return 0
    for trial in trials:
        if trial.key not in found:
            row = trial.measure(given.runs)
            append(given.out, COLUMNS, row)
            print(*(f"{name} {row[name]}" for name in COLUMNS), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
