"""Requirements that a row of the leaderboard must meet to be ranked, and those that results do not meet."""

from collections.abc import Mapping, Sequence
from typing import Any

from thalweg.bench.evaluate.conditions import CONDITIONS
from thalweg.bench.evaluate.course import EvaluationConfig
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.results.curve import CURVE, EPISODES
from thalweg.bench.results.inference import MIN_SEEDS, score_matrix
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import group_episodes
from thalweg.bench.suite.record import has_forces, seeds_of_flown, task_of, training_steps
from thalweg.env.tasks import PAPER_TASK, TASKS
from thalweg.world import LEVELS

LEVEL = "Medium"
"""Level that rankings are made on, as the paper trained there."""
MAX_STEPS = 200_000
"""Most training steps per seed, as in the paper."""
EVALUATION = EvaluationConfig()
"""Number and seed of the starts on each level."""
UNSEEN = next(condition for condition in CONDITIONS if condition.name == "unseen")
RUN_FILES = ("config.yaml", EPISODES, "policy.safetensors")
"""Required files of each training run."""
TASK_FILES = ("config.yaml", f"{EPISODES} or {CURVE}")
"""The same on tasks where safety has a price, whose many flights take too much space."""
_SEEDS = f"{MIN_SEEDS} training seeds or more, all those that its suite names: none is left out because it did badly"
_STEPS = f"at most {MAX_STEPS:,} training steps per seed, earlier stages included"
_STARTS = f"the first {EVALUATION.episodes} starts"
REQUIREMENTS = (
    "the paper's task, in still air and by steps",
    _SEEDS,
    _STEPS,
    f"every seed's flights from {_STARTS} of {', '.join(LEVELS)} (`starts_seed` {EVALUATION.starts_seed}), and as many"
    f" on unseen rivers of each (the condition `{UNSEEN.name}`)",
    f"the folder of its results, from which all figures are computed, with {', '.join(RUN_FILES)} of each training run",
)
"""What a row must have to be ranked on the paper's task."""
TASK_REQUIREMENTS = (
    "a task of the package, in still air, by steps and not in its hard mode",
    _SEEDS,
    _STEPS,
    f"every seed's flights from {_STARTS} of {LEVEL} (`starts_seed` {EVALUATION.starts_seed}), and as many on unseen"
    f" rivers of {LEVEL}",
    f"the folder of its results, with {', '.join(TASK_FILES)} of each training run",
)
"""What a row must have to be ranked on a task where safety has a price."""

Flights = dict[str, list[Episode]]
"""Episodes by level."""


def counted(rows: Sequence[Episode]) -> dict[tuple[str, str], list[Episode]]:
    """Return the episodes of each policy and level from the starts that count."""
    return group_episodes([row for row in rows if row.episode < EVALUATION.episodes])


def missing_of_arm(results: Results, arm: dict[str, Any], usual: Flights, unseen: Flights) -> list[str]:
    """Return what an arm lacks of `REQUIREMENTS`, or of `TASK_REQUIREMENTS` where its task is another, a few words
    each."""
    has_price = task_of(results.suite) != PAPER_TASK
    levels, files = ((LEVEL,), TASK_FILES) if has_price else (tuple(LEVELS), RUN_FILES)
    missing, planned = missing_rules(results, has_price), arm["seeds"]
    if len(planned) < MIN_SEEDS:
        missing.append(f"{MIN_SEEDS} seeds")
    if isinstance(begun := arm.get("begin_with"), Mapping) and not begun.get("taught"):
        missing.append("training from weights drawn by the seed")
    if training_steps(arm) > MAX_STEPS:
        missing.append(f"no more than {MAX_STEPS:,} steps")
    missing += missing_starts(results)
    missing += [line for seed in planned for line in _missing_of_run(results, arm["name"], seed, files)]
    return missing + missing_flights(results, planned, usual, unseen, levels)


def missing_of_flown(results: Results, policy: dict[str, Any], usual: Flights, unseen: Flights) -> list[str]:
    """Return what a policy that was not trained in the results lacks, as `missing_of_arm`, by its record in the
    suite."""
    has_price = task_of(results.suite) != PAPER_TASK
    levels, seeds = (LEVEL,) if has_price else tuple(LEVELS), seeds_of_flown(policy)
    missing = [*missing_rules(results, has_price), *missing_starts(results)]
    return missing + missing_flights(results, seeds, usual, unseen, levels)


def missing_rules(results: Results, has_price: bool) -> list[str]:
    """Return what is missing where rules are not those that are ranked."""
    moved, hard = has_forces(results.suite), has_price and bool(results.suite.get("hard"))
    if not has_price:
        return ["the paper's task in still air"] if moved else []
    needed = {
        "a task of the package": task_of(results.suite) not in TASKS,
        "still air": moved,
        "episodes that go on after a cost": hard,
    }
    return [words for words, is_missing in needed.items() if is_missing]


def missing_starts(results: Results) -> list[str]:
    """Return what is missing where a suite flies from other starts."""
    if results.suite.get("starts_seed") == EVALUATION.starts_seed:
        return []
    return [f"flights from the starts of `starts_seed` {EVALUATION.starts_seed}"]


def missing_flights(
    results: Results, planned: Sequence[int], usual: Flights, unseen: Flights, levels: Sequence[str] = tuple(LEVELS)
) -> list[str]:
    """Return what is missing of the flights of some seeds, a few words each."""
    missing: list[str] = []
    if UNSEEN.as_data() not in results.suite.get("conditions", []):
        unseen = {}
    for episodes, suffix in ((usual, ""), (unseen, " (unseen)")):
        lacking = [level for level in levels if not _is_complete(episodes.get(level, []), planned)]
        missing += [f"flights on {', '.join(lacking)}{suffix}"] if lacking else []
    return missing


def _missing_of_run(results: Results, name: str, seed: int, files: Sequence[str]) -> list[str]:
    """Return what is missing of the training run of a seed: the run itself, or some of its files."""
    run = results.folder / "runs" / f"{name}-{seed}"
    if not any(row.run == run.name and row.status == "finished" for row in results.runs):
        return [f"training seed {seed}"]
    there = {file for file in files if any((run / each).exists() for each in file.split(" or "))}
    if not any((log.algorithm, log.seed) == (name, seed) for log in results.training):
        there -= {file for file in files if EPISODES in file}  # a log that cannot be read counts as missing
    return [f"{file} of seed {seed}" for file in files if file not in there]


def _is_complete(rows: Sequence[Episode], seeds: Sequence[int]) -> bool:
    """Return whether each seed flew every start."""
    try:
        return {row.seed for row in rows} == set(seeds) and len(score_matrix(rows)) == EVALUATION.episodes
    except ValueError:
        return False
