"""Who is ahead, and how sure is that? Trained policies of some results folders in one ranked table.

A row is ranked only if it shows what `REQUIRED` asks for; what a row lacks is said beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from thalweg.bench.beyond import LIMIT, kept
from thalweg.bench.episodes import Episode
from thalweg.bench.files import ResultsError
from thalweg.bench.inference import LEAST_SEEDS, Estimate, middle_return, over_seeds, table_of
from thalweg.bench.reading import read_results
from thalweg.bench.results import Results
from thalweg.bench.statistics import grouped, regret
from thalweg.bench.suites import arms_of
from thalweg.bench.tables import markdown
from thalweg.world import LEVELS

LEAST_STARTS, MOST_STEPS, STARTS_SEED, UNSEEN = 20, 200_000, 0, "unseen"
REQUIRED = (
    f"{LEAST_SEEDS} training seeds or more, all those that its suite names: none is left out because it did badly",
    f"at most {MOST_STEPS:,} steps of training a seed, stages before the last included",
    f"every seed's flights from the first {LEAST_STARTS} starts of each level (`starts_seed` {STARTS_SEED})",
    f"as many flights on unseen rivers (the condition `{UNSEEN}`)",
    "the folder of its results: `suite.json`, `runs.csv`, `evaluation/` and the training runs' `config.yaml`, "
    "`episodes.csv` and `policy.safetensors`, from which all figures are computed",
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
    steps: int
    """Of training, each seed."""
    seeds: int
    level: str
    """That it is ranked by."""
    cost: Estimate
    """Mean, on that level."""
    returns: dict[str, Estimate]
    """Interquartile mean on each level it flew on, and on unseen rivers of the one it is ranked by."""
    regret: float
    """Mean over seeds, in training."""
    lacks: tuple[str, ...]
    """What it does not show of what is required."""

    @property
    def limit(self) -> str:
        """Whether the limit is met, in words of `kept`."""
        return kept(self.cost)

    @property
    def rank(self) -> tuple[int, float]:
        """By which rows are sorted: those first that surely met the limit, then by return."""
        return {"yes": 0, "unsure": 1, "below, unsure": 1}.get(self.limit, 2), -self.returns[self.level].value


def entries(folder: Path) -> list[Entry]:
    """The trained policies of a results folder that have flown on the level of training; raises `ResultsError`."""
    results = read_results(folder)
    level = results.suite.get("train_level", "")
    if level not in LEVELS:
        raise ResultsError(f"{folder} does not say on which level its policies were trained")
    flown, unseen = grouped(results.episodes), grouped(results.beyond.get(UNSEEN, []))
    found = []
    for arm in arms_of(results.suite):
        own = {place: flown[arm["name"], place] for place in LEVELS if (arm["name"], place) in flown}
        if level not in own:
            continue
        elsewhere = {place: unseen[arm["name"], place] for place in LEVELS if (arm["name"], place) in unseen}
        steps = sum(stage["steps"] for stage in (*arm.get("before", ()), arm))
        returns = {place: middle_return(rows) for place, rows in own.items()}
        if level in elsewhere:
            returns[UNSEEN] = middle_return(elsewhere[level])
        found.append(
            Entry(
                arm["name"],
                folder.resolve().name,
                str((results.suite.get("made_by") or {}).get("source") or "unknown")[:8],
                steps,
                len({row.seed for row in own[level]}),
                level,
                _mean_cost(own[level]),
                returns,
                _regret(results, arm["name"]),
                tuple(_lacking(results, arm, steps, own, elsewhere)),
            )
        )
    return found


def _mean_cost(rows: Sequence[Episode]) -> Estimate:
    """The mean cost; without an interval where a seed did not fly every start."""
    try:
        return over_seeds(table_of(rows, "cost"), np.mean)
    except ValueError:
        return Estimate(float(np.mean([row.cost for row in rows])))


def _regret(results: Results, policy: str) -> float:
    """The mean over seeds of what training cost beyond the limit; NaN where no log of it is there."""
    found = [regret(log, LIMIT) for log in results.training if log.algorithm == policy]
    return float(np.mean(found)) if found else float("nan")


def _lacking(
    results: Results,
    arm: dict,
    steps: int,
    own: dict[str, list[Episode]],
    elsewhere: dict[str, list[Episode]],
) -> list[str]:
    """What an arm does not show of `REQUIRED`, a few words each."""
    lacks, planned = [], arm["seeds"]
    if len(planned) < LEAST_SEEDS:
        lacks.append(f"{LEAST_SEEDS} seeds")
    if steps > MOST_STEPS:
        lacks.append(f"no more than {MOST_STEPS:,} steps")
    if results.suite.get("starts_seed") != STARTS_SEED:
        lacks.append(f"flights from the starts of `starts_seed` {STARTS_SEED}")
    lacks += [f"training seed {seed}" for seed in planned if not _trained(results, arm["name"], seed)]
    for rows, where in ((own, ""), (elsewhere, " (unseen)")):
        short = [level for level in LEVELS if not _complete(rows.get(level, []), planned)]
        if short:
            lacks.append(f"flights on {', '.join(short)}{where}")
    return lacks


def _trained(results: Results, policy: str, seed: int) -> bool:
    return any(
        (row.algorithm, row.seed, row.status, row.kind) == (policy, seed, "finished", "train") for row in results.runs
    )


def _complete(rows: Sequence[Episode], seeds: Sequence[int]) -> bool:
    """Whether each seed flew enough starts, the same as the others."""
    try:
        table = table_of(rows) if rows else np.zeros((0, 0))
    except ValueError:
        return False
    return {row.seed for row in rows} == set(seeds) and len(table) >= LEAST_STARTS


def leaderboard(folders: Sequence[Path]) -> str:
    """The page of some results folders in Markdown; raises `ResultsError` where there is none, for one that can't
    be used, and where two have the same name."""
    if not folders:
        raise ResultsError("give at least one folder that `thalweg bench` wrote")
    names = [folder.resolve().name for folder in folders]
    for name in names:
        if names.count(name) > 1:
            raise ResultsError(f"two folders are called {name!r}; a row is told by its policy and its folder's name")
    found = [entry for folder in folders for entry in entries(folder)]
    ranked = sorted((entry for entry in found if not entry.lacks), key=lambda entry: entry.rank)
    others = sorted((entry for entry in found if entry.lacks), key=lambda entry: entry.rank)
    header = [
        "", "policy", "results", "limit met", "cost", "return", "Easy", "Hard", "unseen", "regret", "steps", "seeds",
        "code",
    ]  # fmt: skip
    board = markdown(header, [[str(place), *_cells(entry)] for place, entry in enumerate(ranked, start=1)])
    rest = markdown([*header[1:], "lacks"], [[*_cells(entry), "; ".join(entry.lacks)] for entry in others])
    required = "\n".join(f"- {line};" for line in REQUIRED).removesuffix(";") + "."
    parts = [HEAD.format(limit=LIMIT), board if ranked else "No row is complete yet.\n", f"A row shows\n\n{required}\n"]
    parts += [f"## Not ranked\n\nWhat these lack stands in the last column.\n\n{rest}"] if others else []
    return "\n".join(parts)


HEAD = """# Leaderboard

Made from results folders by `thalweg leaderboard`, and from nothing else. First come policies whose mean cost an
episode is within {limit} as far as the whole interval tells (*yes*), then those of which that is *unsure*, then the
others; among each, the greater return on the level of training leads. Return: interquartile mean, of at most 10, on the
level of training, on Easy, on Hard, and on unseen rivers of the level of training; in brackets intervals of 95 % over
training seeds. Regret: what training cost beyond the limit, an episode. Code: a mark of the sources that made the row;
worlds and pictures of different code may differ.
"""


def _cells(entry: Entry) -> list[str]:
    """A row, from the policy's name on."""
    at = [str(entry.returns.get(place, "—")) for place in (entry.level, "Easy", "Hard", UNSEEN)]
    worse = "unknown" if np.isnan(entry.regret) else f"{entry.regret:.2f}"
    rest = [worse, f"{entry.steps:,}", str(entry.seeds), entry.code]
    return [entry.policy, entry.source, entry.limit, str(entry.cost), *at, *rest]
