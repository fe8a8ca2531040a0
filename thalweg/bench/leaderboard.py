"""The leaderboard: trained policies of several results folders in one ranked table.

A row is ranked only if it has everything that `REQUIREMENTS` lists; rows that lack something stand apart with what they
lack.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import CONDITIONS
from thalweg.bench.evaluate.course import EvaluationConfig
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.report.policies import COST_LIMIT, CRITICS_SEE, limit_met, training_regret
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.results.inference import CONFIDENCE, MIN_SEEDS, Estimate, mean_estimate, score_matrix
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import group_episodes
from thalweg.bench.suite.record import arms_of, encoder_of, has_papers_rules, observation_of
from thalweg.train.observations import FRAMES, IMAGES, PRIVILEGED
from thalweg.world import LEVELS

LEVEL = "Medium"
"""Level that the ranking is made on, as the paper trained there."""
MAX_STEPS = 200_000
"""Most training steps per seed, as in the paper."""
EVALUATION = EvaluationConfig()
"""Number and seed of the starts on each level."""
UNSEEN = next(condition for condition in CONDITIONS if condition.name == "unseen")
EPISODE_LOG = "episodes.csv"
"""File of a training run that its regret is computed from."""
RUN_FILES = ("config.yaml", EPISODE_LOG, "policy.safetensors")
"""Required files of each training run."""
REQUIREMENTS = (
    "the paper's task, in still air and by steps",
    f"{MIN_SEEDS} training seeds or more, all those that its suite names: none is left out because it did badly",
    f"at most {MAX_STEPS:,} training steps per seed, earlier stages included",
    f"every seed's flights from the first {EVALUATION.episodes} starts of {', '.join(LEVELS)} (`starts_seed`"
    f" {EVALUATION.starts_seed}), and as many on unseen rivers of each (the condition `{UNSEEN.name}`)",
    f"the folder of its results, from which all figures are computed, with {', '.join(RUN_FILES)} of each training run",
)
"""What a row must have to be ranked."""


@dataclass(frozen=True)
class Entry:
    """A trained policy and its figures."""

    policy: str
    source: str
    """Name of the results folder."""
    versions: str
    """The versions that the results were made with: `current`, or those that differ."""
    level: str
    """Training level."""
    steps: int
    """Training steps of each seed."""
    seeds: int
    """Number of seeds whose training finished."""
    cost: Estimate | None
    """Mean on `LEVEL`; None where the policy was not evaluated there."""
    returns: dict[str, Estimate]
    """Mean on each level, and on unseen rivers of `LEVEL`; an interquartile mean would hide up to a quarter of
    failures."""
    regret: float | None
    """Mean over seeds, in the last stage of training; None where it is not known."""
    missing: tuple[str, ...]
    """What the results lack of `REQUIREMENTS`."""
    critics_see: str = "none"
    """What its critics saw in training, see `Results.critics_see`."""
    observation: str = FRAMES
    """What the policy sees, see `thalweg.train.observations.IN_WORDS`."""
    encoder: str = "default"
    """Name of the packaged encoder of its frames, if it sees their codes."""
    made_by: str = ""
    """Version and source of the plug-ins that it was trained by, or of the function that it is."""
    trained: bool = True
    """Whether it was trained here; a function was not."""

    @property
    def privileged(self) -> bool:
        """Whether the policy sees the privileged observation instead of frames."""
        return self.observation == PRIVILEGED

    @property
    def limit_met(self) -> str:
        """Whether the cost limit is met, in words."""
        return "unknown" if self.cost is None else limit_met(self.cost)

    @property
    def sort_key(self) -> tuple[int, float]:
        """Policies that surely meet the limit come first; then the greater return does."""
        group = {"yes": 0, "no": 2, "unknown": 3}.get(self.limit_met, 1)
        return group, -self.returns[LEVEL].value if LEVEL in self.returns else 0.0


def entries(folder: Path) -> list[Entry]:
    """Return the trained policies of a results folder, as far as any run of them has started.

    Raises `ResultsError` for a folder that holds no results, or no readable suite.
    """
    results = read_results(folder)
    if not results.suite:
        raise ResultsError(
            f"{folder}: {next((line for line in results.skipped if 'suite.json' in line), 'no suite.json')}"
        )
    evaluated, unseen = (_counted(rows) for rows in (results.episodes, results.condition_episodes.get(UNSEEN.name, [])))
    found = []
    for arm in arms_of(results.suite):
        for name in (arm["name"], *_outdated_names(results, arm["name"])):
            usual, other = (
                {level: rows for level in LEVELS if (rows := each.get((name, level)))} for each in (evaluated, unseen)
            )
            if usual or any(row.algorithm == name for row in results.runs):
                found.append(_entry(results, name, arm, usual, other))
    for function in results.suite.get("policies", []):
        for name in (function["name"], *_outdated_names(results, function["name"])):
            usual, other = (
                {level: rows for level in LEVELS if (rows := each.get((name, level)))} for each in (evaluated, unseen)
            )
            if usual:
                found.append(_function_entry(results, name, function, usual, other))
    return found


def _outdated_names(results: Results, policy: str) -> list[str]:
    """The names under which a policy stands in results with other versions."""
    return [name for name, found in results.outdated.items() if found.policy == policy]


def _returns(usual: dict[str, list[Episode]], unseen: dict[str, list[Episode]]) -> dict[str, Estimate]:
    """The mean return on each level, and on unseen rivers of `LEVEL`."""
    returns = {level: mean_estimate(rows, "return_") for level, rows in usual.items()}
    return returns | ({UNSEEN.name: mean_estimate(unseen[LEVEL], "return_")} if LEVEL in unseen else {})


def _function_entry(
    results: Results,
    name: str,
    function: dict[str, Any],
    usual: dict[str, list[Episode]],
    unseen: dict[str, list[Episode]],
) -> Entry:
    """The entry of a function with its episodes, which were flown once and cannot be compared over seeds."""
    outdated = results.outdated.get(name)
    seeds = [0]
    missing = [*_missing_starts(results), *_missing_flights(results, seeds, usual, unseen)]
    return Entry(
        policy=function["name"],
        source=results.folder.resolve().name,
        versions="current" if outdated is None else outdated.versions,
        level="not here",
        steps=0,
        seeds=len(seeds),
        cost=mean_estimate(usual[LEVEL], "cost") if LEVEL in usual else None,
        returns=_returns(usual, unseen),
        regret=None,
        missing=("current versions",) if outdated else tuple(missing),
        observation=function["observation"],
        encoder=results.suite.get("encoder", "default"),
        made_by=results.made_by([f"{function['name']}-0"]),
        trained=False,
    )


def _entry(
    results: Results,
    name: str,
    arm: dict[str, Any],
    usual: dict[str, list[Episode]],
    unseen: dict[str, list[Episode]],
) -> Entry:
    """The entry of an arm with its episodes on each level, on the usual and on unseen rivers.

    `name` is that of its episodes: the arm's, or that of its outdated runs.
    """
    outdated = results.outdated.get(name)
    return Entry(
        policy=arm["name"],
        source=results.folder.resolve().name,
        versions="current" if outdated is None else outdated.versions,
        level=arm.get("level") or results.suite.get("train_level", "unknown"),
        steps=_training_steps(arm),
        seeds=sum(row.algorithm == name and row.status == "finished" for row in results.runs),
        cost=mean_estimate(usual[LEVEL], "cost") if LEVEL in usual else None,
        returns=_returns(usual, unseen),
        regret=training_regret(results, name),
        missing=("current versions",) if outdated else tuple(_missing(results, arm, usual, unseen)),
        critics_see=results.critics_see(name),
        observation=observation_of(results.suite, arm),
        encoder=encoder_of(results.suite, arm),
        made_by=results.made_by([f"{arm['name']}-{seed}" for seed in arm["seeds"]]),
    )


def _counted(rows: Sequence[Episode]) -> dict[tuple[str, str], list[Episode]]:
    """The episodes of each policy and level from the starts that count."""
    return group_episodes([row for row in rows if row.episode < EVALUATION.episodes])


def _training_steps(arm: dict[str, Any]) -> int:
    """Training steps of each seed, all stages together."""
    return sum(stage["steps"] for stage in (*arm.get("before", ()), arm))


def _missing(
    results: Results, arm: dict[str, Any], usual: dict[str, list[Episode]], unseen: dict[str, list[Episode]]
) -> list[str]:
    """What an arm lacks of `REQUIREMENTS`, a few words each."""
    missing, planned = [], arm["seeds"]
    if not has_papers_rules(results.suite):
        missing.append("the paper's task in still air")
    if len(planned) < MIN_SEEDS:
        missing.append(f"{MIN_SEEDS} seeds")
    if _training_steps(arm) > MAX_STEPS:
        missing.append(f"no more than {MAX_STEPS:,} steps")
    missing += _missing_starts(results)
    missing += [line for seed in planned for line in _missing_of_run(results, arm["name"], seed)]
    return missing + _missing_flights(results, planned, usual, unseen)


def _missing_starts(results: Results) -> list[str]:
    """What is missing where a suite flies from other starts."""
    if results.suite.get("starts_seed") == EVALUATION.starts_seed:
        return []
    return [f"flights from the starts of `starts_seed` {EVALUATION.starts_seed}"]


def _missing_flights(
    results: Results, planned: Sequence[int], usual: dict[str, list[Episode]], unseen: dict[str, list[Episode]]
) -> list[str]:
    """What is missing of the flights of some seeds, a few words each."""
    missing: list[str] = []
    if UNSEEN.as_data() not in results.suite.get("conditions", []):
        unseen = {}
    for episodes, suffix in ((usual, ""), (unseen, " (unseen)")):
        levels = [level for level in LEVELS if not _is_complete(episodes.get(level, []), planned)]
        missing += [f"flights on {', '.join(levels)}{suffix}"] if levels else []
    return missing


def _missing_of_run(results: Results, name: str, seed: int) -> list[str]:
    """What is missing of the training run of a seed: the run itself, or some of its files."""
    run = results.folder / "runs" / f"{name}-{seed}"
    if not any(row.run == run.name and row.status == "finished" for row in results.runs):
        return [f"training seed {seed}"]
    files = {file for file in RUN_FILES if (run / file).exists()}
    if not any((log.algorithm, log.seed) == (name, seed) for log in results.training):
        files.discard(EPISODE_LOG)  # a log that cannot be read counts as missing
    return [f"{file} of seed {seed}" for file in RUN_FILES if file not in files]


def _is_complete(rows: Sequence[Episode], seeds: Sequence[int]) -> bool:
    """Whether each seed flew every start."""
    try:
        return {row.seed for row in rows} == set(seeds) and len(score_matrix(rows)) == EVALUATION.episodes
    except ValueError:
        return False


def leaderboard(folders: Sequence[Path]) -> str:
    """Return the leaderboard of some results folders as a page in Markdown.

    Raises `ResultsError` for no folder, for one that cannot be used, and for two with the same name.
    """
    if not folders:
        raise ResultsError("give at least one folder that `thalweg bench` wrote")
    names = [folder.resolve().name for folder in folders]
    for name in names:
        if names.count(name) > 1:
            raise ResultsError(
                f"two folders are named {name!r}; a row is identified by its policy and its folder's name"
            )
    found = sorted((entry for folder in folders for entry in entries(folder)), key=lambda entry: entry.sort_key)
    complete = [entry for entry in found if not entry.missing]
    ranked, privileged = (
        _ranked([entry for entry in complete if entry.trained and entry.privileged == apart]) for apart in (False, True)
    )
    functions = _ranked([entry for entry in complete if not entry.trained])
    unranked = [[*_row(entry), "; ".join(entry.missing)] for entry in found if entry.missing]
    requirements = "\n".join(f"- {line};" for line in REQUIREMENTS).removesuffix(";") + "."
    paragraphs = [
        INTRODUCTION,
        f"```sh\n{shlex.join(['thalweg', 'leaderboard', *map(str, folders)])}\n```\n",
        ranked or "No row is complete yet.\n",
        f"A row shows\n\n{requirements}\n",
    ]
    if privileged:
        paragraphs.append(f"## With the privileged observation\n\n{PRIVILEGED_NOTE}\n\n{privileged}")
    if functions:
        paragraphs.append(f"## Not trained here\n\n{FUNCTIONS_NOTE}\n\n{functions}")
    if unranked:
        table = markdown(frame([*COLUMNS, "lacks"], unranked))
        paragraphs.append(f"## Not ranked\n\nThe last column names what these rows lack.\n\n{table}")
    return "\n".join(paragraphs)


INTRODUCTION = f"""# Leaderboard

The command below computes this page from the files of results folders. A policy meets the cost limit (*yes*) if the
whole confidence interval of its mean cost per episode on {LEVEL} is within {COST_LIMIT}. These policies come first,
then those for which this is *unsure*, then the others. Within each group, policies are ranked by their return on
{LEVEL}. Returns are means, of at most 10. Brackets hold {CONFIDENCE:.0%} confidence intervals over training seeds. With
fewer than {MIN_SEEDS} seeds there is no interval, and *below, unsure* or *above, unsure* says on which side of the
limit the mean cost lies.

*Unseen* is the return on rivers of {LEVEL} that nothing is trained on. *Regret* is the cost of training above the
limit, per episode of the last stage. *Critics see* is about training: no policy is flown with critics. *Versions* is
*current* if the row was made with the current versions of everything that results depend on. Otherwise it names the
versions that differ, and the row is not ranked until it has been run again.

Policies see frames through an encoder, that of the autoencoder unless *(geometry)* follows the name. The name of one
that sees images itself is followed by their channels, {" or ".join(f"*({channels})*" for channels in IMAGES)}.
"""
PRIVILEGED_NOTE = """These policies see what a perfect camera could tell instead of frames, so they are ranked among
themselves."""
FUNCTIONS_NOTE = """Functions that were flown as they are, each once from every start, so that there is no interval over
seeds. *Versions* has the version and the hash of the source of each."""
OTHER_LEVELS = tuple(level for level in LEVELS if level != LEVEL)
COLUMNS = (
    "policy", "results", "limit met", "cost", LEVEL, *OTHER_LEVELS, "unseen", "regret",
    "trained on", "steps", "seeds", CRITICS_SEE, "versions",
)  # fmt: skip


def _ranked(complete: Sequence[Entry]) -> str:
    """Return the table of complete entries, the best first; empty without any."""
    rows = [[str(rank), *_row(entry)] for rank, entry in enumerate(complete, start=1)]
    return markdown(frame(["", *COLUMNS], rows)) if rows else ""


def _row(entry: Entry) -> list[str]:
    """A row of `COLUMNS` as text."""
    returns = [str(entry.returns.get(river, "missing")) for river in (LEVEL, *OTHER_LEVELS, UNSEEN.name)]
    cost = "missing" if entry.cost is None else str(entry.cost)
    regret = "unknown" if entry.regret is None else f"{entry.regret:.2f}"
    made = f"{entry.versions}; {entry.made_by}" if entry.made_by else entry.versions
    rest = [regret, entry.level, f"{entry.steps:,}", str(entry.seeds), entry.critics_see, made]
    seen = entry.encoder if entry.observation == FRAMES else entry.observation
    policy = entry.policy if seen == "default" else f"{entry.policy} ({seen})"
    return [policy, entry.source, entry.limit_met, cost, *returns, *rest]
