"""Who is ahead, and how sure is that? Trained policies of some results folders in one ranked table.

A row is ranked only if it shows what `REQUIRED` asks for; what a row lacks is said beside it.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import BEYOND
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.evaluate.evaluation import EvaluationConfig
from thalweg.bench.report.extra_tables import LIMIT, kept, training_regret
from thalweg.bench.report.tables import markdown
from thalweg.bench.results.inference import CONFIDENCE, LEAST_SEEDS, Estimate, mean_of, table_of
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import grouped
from thalweg.bench.suite.suites import arms_of
from thalweg.world import LEVELS

LEVEL = "Medium"
"""On which all are ranked, as the paper trained there."""
MOST_STEPS = 200_000
"""Of training each seed, as in the paper."""
FLOWN = EvaluationConfig()
"""How many starts on each level, and which."""
UNSEEN = next(condition for condition in BEYOND if condition.name == "unseen")
LOG = "episodes.csv"
"""From which the regret is computed."""
FILES = ("config.yaml", LOG, "policy.safetensors")
"""Of each training run."""
REQUIRED = (
    f"{LEAST_SEEDS} training seeds or more, all those that its suite names: none is left out because it did badly",
    f"at most {MOST_STEPS:,} steps of training a seed, stages before the last included",
    f"every seed's flights from the first {FLOWN.episodes} starts of {', '.join(LEVELS)} (`starts_seed`"
    f" {FLOWN.starts_seed}), and as many on unseen rivers of each (the condition `{UNSEEN.name}`)",
    f"the folder of its results, from which all figures are computed, with {', '.join(FILES)} of each training run",
)
"""What a row must show to be ranked."""


@dataclass(frozen=True)
class Entry:
    """A trained policy and its figures."""

    policy: str
    source: str
    """Name of the folder of its results."""
    code: str
    """Mark of the sources that made them."""
    level: str
    """That it was trained on."""
    steps: int
    """Of training, each seed."""
    seeds: int
    """Whose training finished."""
    cost: Estimate | None
    """Mean on `LEVEL`; None where it has not flown there."""
    returns: dict[str, Estimate]
    """Mean on each level it flew on, and on unseen rivers of `LEVEL`; an interquartile mean would hide up to a quarter
    of failures."""
    regret: float | None
    """Mean over seeds, in the last stage of training; None where that is not known."""
    lacks: tuple[str, ...]
    """What it does not show of what is required."""

    @property
    def limit(self) -> str:
        """Whether the limit is met, in words of `kept`."""
        return "unknown" if self.cost is None else kept(self.cost)

    @property
    def rank(self) -> tuple[int, float]:
        """By which rows are sorted: those first that surely met the limit, then by return."""
        place = {"yes": 0, "no": 2, "unknown": 3}.get(self.limit, 1)
        return place, -self.returns[LEVEL].value if LEVEL in self.returns else 0.0


def entries(folder: Path) -> list[Entry]:
    """The trained policies of a results folder that have begun; raises `ResultsError` where it holds no results, or
    does not say which."""
    results = read_results(folder)
    if not results.suite:
        raise ResultsError(
            f"{folder}: {next((line for line in results.skipped if 'suite.json' in line), 'no suite.json')}"
        )
    flown, unseen = (_first(rows) for rows in (results.episodes, results.beyond.get(UNSEEN.name, [])))
    found = []
    for arm in arms_of(results.suite):
        own = {place: flown[arm["name"], place] for place in LEVELS if (arm["name"], place) in flown}
        elsewhere = {place: unseen[arm["name"], place] for place in LEVELS if (arm["name"], place) in unseen}
        begun = any(row.algorithm == arm["name"] for row in results.runs)
        if not own and not begun:
            continue
        returns = {place: mean_of(rows, "return_") for place, rows in own.items()}
        if LEVEL in elsewhere:
            returns[UNSEEN.name] = mean_of(elsewhere[LEVEL], "return_")
        found.append(
            Entry(
                arm["name"],
                folder.resolve().name,
                str((results.suite.get("made_by") or {}).get("source") or "unknown")[:8],
                arm.get("level") or results.suite.get("train_level", "unknown"),
                _steps(arm),
                sum(row.algorithm == arm["name"] and row.status == "finished" for row in results.runs),
                mean_of(own[LEVEL], "cost") if LEVEL in own else None,
                returns,
                training_regret(results, arm["name"]),
                tuple(_lacking(results, arm, own, elsewhere)),
            )
        )
    return found


def _first(rows: Sequence[Episode]) -> dict[tuple[str, str], list[Episode]]:
    """The flights of each policy and level from as many starts as count."""
    return grouped([row for row in rows if row.episode < FLOWN.episodes])


def _steps(arm: dict[str, Any]) -> int:
    """Of training with each seed, all stages together."""
    return sum(stage["steps"] for stage in (*arm.get("before", ()), arm))


def _lacking(
    results: Results, arm: dict[str, Any], own: dict[str, list[Episode]], elsewhere: dict[str, list[Episode]]
) -> list[str]:
    """What an arm does not show of `REQUIRED`, a few words each."""
    lacks, planned = [], arm["seeds"]
    logs = {log.seed for log in results.training if log.algorithm == arm["name"]}
    if len(planned) < LEAST_SEEDS:
        lacks.append(f"{LEAST_SEEDS} seeds")
    if _steps(arm) > MOST_STEPS:
        lacks.append(f"no more than {MOST_STEPS:,} steps")
    if results.suite.get("starts_seed") != FLOWN.starts_seed:
        lacks.append(f"flights from the starts of `starts_seed` {FLOWN.starts_seed}")
    for seed in planned:
        home = results.folder / "runs" / f"{arm['name']}-{seed}"
        finished = any(row.run == home.name and row.status == "finished" for row in results.runs)
        missing = [name for name in FILES if not (home / name).exists() or (name == LOG and seed not in logs)]
        lacks += [f"training seed {seed}"] if not finished else [f"{name} of seed {seed}" for name in missing]
    if UNSEEN.as_data() not in results.suite.get("conditions", []):
        elsewhere = {}
    for rows, where in ((own, ""), (elsewhere, " (unseen)")):
        short = [level for level in LEVELS if not _complete(rows.get(level, []), planned)]
        lacks += [f"flights on {', '.join(short)}{where}"] if short else []
    return lacks


def _complete(rows: Sequence[Episode], seeds: Sequence[int]) -> bool:
    """Whether each seed flew every start."""
    try:
        return {row.seed for row in rows} == set(seeds) and len(table_of(rows)) == FLOWN.episodes
    except ValueError:
        return False


def leaderboard(folders: Sequence[Path]) -> str:
    """The page of some results folders in Markdown; raises `ResultsError` where there is none, for one that can't be
    used, and where two have the same name."""
    if not folders:
        raise ResultsError("give at least one folder that `thalweg bench` wrote")
    names = [folder.resolve().name for folder in folders]
    for name in names:
        if names.count(name) > 1:
            raise ResultsError(f"two folders are called {name!r}; a row is told by its policy and its folder's name")
    found = sorted((entry for folder in folders for entry in entries(folder)), key=lambda entry: entry.rank)
    ranked = [[str(place), *_cells(entry)] for place, entry in enumerate((e for e in found if not e.lacks), start=1)]
    others = [[*_cells(entry), "; ".join(entry.lacks)] for entry in found if entry.lacks]
    required = "\n".join(f"- {line};" for line in REQUIRED).removesuffix(";") + "."
    command = shlex.join(["thalweg", "leaderboard", *map(str, folders)])
    parts = [
        HEAD,
        f"```sh\n{command}\n```\n",
        markdown(["", *COLUMNS], ranked) if ranked else "No row is complete yet.\n",
    ]
    parts += [f"A row shows\n\n{required}\n"]
    parts += [f"## Not ranked\n\nWhat these lack stands in the last column.\n\n{_rest(others)}"] if others else []
    return "\n".join(parts)


HEAD = f"""# Leaderboard

Made by the command below from results folders, and from nothing else. First come policies whose mean cost an episode on
{LEVEL} is within {LIMIT} as far as the whole interval tells (*yes*), then those of which that is *unsure*, then the
others; among each, the greater return on {LEVEL} leads. Returns are means, of at most 10; in brackets
stand intervals of {CONFIDENCE:.0%} over training seeds. Of fewer than {LEAST_SEEDS} there is none, and *below, unsure*
or *above, unsure* says where the mean cost lies.

*Unseen*: rivers of {LEVEL} on which nothing is trained. *Regret*: what training cost beyond the limit, an episode of
the last stage. *Code*: a mark of the sources that made the row; worlds and pictures of different code may differ.
"""
COLUMNS = (
    "policy", "results", "limit met", "cost", LEVEL, *(level for level in LEVELS if level != LEVEL), "unseen", "regret",
    "trained on", "steps", "seeds", "code",
)  # fmt: skip


def _rest(others: list[list[str]]) -> str:
    return markdown([*COLUMNS, "lacks"], others)


def _cells(entry: Entry) -> list[str]:
    """A row, from the policy's name on."""
    places = (LEVEL, *(level for level in LEVELS if level != LEVEL), UNSEEN.name)
    returns = [str(entry.returns.get(place, "missing")) for place in places]
    cost = "missing" if entry.cost is None else str(entry.cost)
    regret = "unknown" if entry.regret is None else f"{entry.regret:.2f}"
    rest = [regret, entry.level, f"{entry.steps:,}", str(entry.seeds), entry.code]
    return [entry.policy, entry.source, entry.limit, cost, *returns, *rest]
