"""The paper's table of returns and costs with published figures beside it, and the table of details."""

from collections.abc import Callable, Sequence
from itertools import product

from thalweg.bench.evaluate.episodes import FIRST_COST, Episode
from thalweg.bench.report.policies import seeds_text
from thalweg.bench.report.published import PUBLISHED, Published
from thalweg.bench.report.table import PAPER, Table, estimate_figures, frame
from thalweg.bench.results.inference import Bounds, Estimate, bootstrap_iqm_return, iqm_return, proportion
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import Summary, group_episodes, mean_and_std_text, summaries
from thalweg.bench.suite.record import bounds_of, has_papers_rules

UNPUBLISHED = "not published"
"""Text where the paper gives no figure for a level on which it has others."""
STATISTICS = ("return_mean", "return_std", "cost_mean", "cost_std", "success", "tight", "loose", "length_mean")
PAPER_FIGURES = ("source", "policy", "level", "episodes", "seeds", "planned_seeds", *STATISTICS)
"""Columns of the figures, before a count for each of the `Results.reasons`."""
PAPER_EPISODES, PAPER_SEEDS = 60, 3
"""Episodes and seeds of each published figure."""


def paper_table(results: Results, *, published: bool = True) -> Table:
    """Return the paper's table: seeds, and return and cost on each level, ours and below them the published ones.

    Every algorithm of the results has a row; where it has no episodes, its cells say why. The figures have one row per
    policy and level, with `source` to tell the published ones apart. The published policies see frames and stand below
    no policy that does not, nor below results by other rules; nor anywhere unless `published` ones are asked for.
    """
    apart = results.privileged
    comparable = PUBLISHED if published and has_papers_rules(results.suite) else {}
    beside = {pair: figures for pair, figures in comparable.items() if pair[0] not in apart}
    by_policy_and_level = summaries(results.episodes)
    columns = ["policy", "seeds", *(f"{level} {what}" for level in results.levels for what in ("return", "cost"))]
    rows = []
    for algorithm in results.policies:
        measured = [
            _measured_texts(results, algorithm, by_policy_and_level.get((algorithm, level))) for level in results.levels
        ]
        flown = [cell.seeds for level in results.levels if (cell := by_policy_and_level.get((algorithm, level)))]
        rows.append([algorithm, _flown_seeds(results, algorithm, flown), *(text for pair in measured for text in pair)])
        if any((algorithm, level) in beside for level in results.levels):
            published_values = [_published_texts(algorithm, level) for level in results.levels]
            row = [f"{algorithm} ({PAPER})", str(PAPER_SEEDS), *(text for pair in published_values for text in pair)]
            rows.append(row)
    pairs = product(results.policies, results.levels)
    figures = [
        row for pair in pairs for row in _paper_figures(results, by_policy_and_level.get(pair), beside.get(pair), *pair)
    ]
    return Table(frame(columns, rows), frame((*PAPER_FIGURES, *results.reasons), figures))


def _measured_texts(results: Results, algorithm: str, cell: Summary | None) -> tuple[str, str]:
    """Return and cost as text."""
    if cell is None:
        return results.gap(algorithm), results.gap(algorithm)
    return mean_and_std_text(cell.return_mean, cell.return_std), mean_and_std_text(cell.cost_mean, cell.cost_std)


def _flown_seeds(results: Results, algorithm: str, flown: list[int]) -> str:
    """Return how many seeds flew, such as `3`, `2 of 3` where some are missing, or `1 to 2 of 3` between the levels."""
    fewest = seeds_text(results, algorithm, min(flown, default=0))
    return fewest if len(set(flown)) < 2 else f"{min(flown)} to {seeds_text(results, algorithm, max(flown))}"


def _published_texts(algorithm: str, level: str) -> tuple[str, str]:
    """Published return and cost as text."""
    cell = PUBLISHED.get((algorithm, level))
    if cell is None:
        return UNPUBLISHED, UNPUBLISHED
    return mean_and_std_text(cell.return_mean, cell.return_std), mean_and_std_text(cell.cost_mean, cell.cost_std)


def _paper_figures(
    results: Results, cell: Summary | None, published: Published | None, algorithm: str, level: str
) -> list[list[object]]:
    """Rows of the figures for a policy on a level: ours, and the published one if there is one."""
    blanks = [None] * (len(STATISTICS) + len(results.reasons))
    numbers = (
        [*(getattr(cell, name) for name in STATISTICS), *(cell.reasons[reason] for reason in results.reasons)]
        if cell
        else blanks
    )
    counts = [cell.episodes, cell.seeds] if cell else [0, 0]
    rows: list[list[object]] = [["thalweg", algorithm, level, *counts, results.planned_seeds(algorithm), *numbers]]
    if published is not None:
        published_values = [published.return_mean, published.return_std, published.cost_mean, published.cost_std]
        counts = [PAPER_EPISODES, PAPER_SEEDS, PAPER_SEEDS]
        rows.append([PAPER, algorithm, level, *counts, *published_values, *blanks[len(published_values) :]])
    return rows


DETAILS: dict[str, tuple[str, Callable[[Sequence[Episode], Bounds], Estimate]]] = {
    "return, IQM": ("return_iqm", iqm_return),
    "return, IQM (bootstrap)": ("return_iqm_bootstrap", bootstrap_iqm_return),
    "success": ("success", lambda rows, _: proportion(rows, lambda row: row.success)),
    "tight violation": ("tight", lambda rows, _: proportion(rows, lambda row: row.tight > 0)),
    "loose violation": ("loose", lambda rows, _: proportion(rows, lambda row: row.loose > 0)),
    "ended by a cost": ("cost_incurred", lambda rows, _: proportion(rows, lambda row: row.reason == FIRST_COST)),
}
"""Estimates by their headings: their name among the figures, and how they are computed from episodes and the bounds of
their returns."""
HARD_DETAILS = ("ended by a cost",)
"""Those of results of the hard mode only."""


def detail_table(results: Results) -> Table:
    """Return the details that the paper's table leaves out, one row per policy and level, with 95 % intervals."""
    by_policy_and_level, groups = summaries(results.episodes), group_episodes(results.episodes)
    shown = {heading: each for heading, each in DETAILS.items() if results.hard or heading not in HARD_DETAILS}
    columns = ["policy", "level", "episodes", "seeds", *shown, "course flown", "steps"]
    named = [f"{name}{end}" for name, _ in shown.values() for end in ("", "_low", "_high")]
    counted = ["policy", "level", "episodes", "seeds", "planned_seeds", *named, "progress_mean", "length_mean"]
    texts, figures = [], []
    for algorithm, level in product(results.policies, results.levels):
        cell, planned = by_policy_and_level.get((algorithm, level)), results.planned_seeds(algorithm)
        seeds = seeds_text(results, algorithm, cell.seeds if cell else 0)
        if cell is None:
            gap = results.gap(algorithm)
            texts.append([algorithm, level, gap, seeds, *[gap] * (len(columns) - 4)])
            figures.append([algorithm, level, 0, 0, planned, *[None] * (len(counted) - 5)])
            continue
        episodes = groups[algorithm, level]
        bounds = bounds_of(results.suite, "return_", episodes)
        estimates = [estimate(episodes, bounds) for _, estimate in shown.values()]
        ahead = "" if cell.ahead_mean is None else f" ({cell.ahead_mean:.0%} of what lay ahead)"
        means = [f"{cell.progress_mean:.0%}{ahead}", f"{cell.length_mean:.0f}"]
        texts.append([algorithm, level, str(cell.episodes), seeds, *map(str, estimates), *means])
        numbers = [number for estimate in estimates for number in estimate_figures(estimate)]
        counts = [cell.episodes, cell.seeds, planned]
        figures.append([algorithm, level, *counts, *numbers, cell.progress_mean, cell.length_mean])
    return Table(frame(columns, texts), frame(counted, figures))
