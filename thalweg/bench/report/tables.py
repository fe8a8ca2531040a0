"""How do the figures stand beside one another? The report's tables as text to be read, and as CSV at full precision.

The paper's table has ours above each published row; what a page and a paper make of the text is not said here.
"""

import re
from itertools import product

import numpy as np

from thalweg.bench.csv_files import csv_text
from thalweg.bench.evaluate.episodes import REASONS
from thalweg.bench.report.published import PUBLISHED
from thalweg.bench.results.inference import Estimate, bootstrapped_return, middle_return, share
from thalweg.bench.results.results import Results, runs_text
from thalweg.bench.results.statistics import Summary, grouped, summaries

Grid = tuple[list[str], list[list[str]]]
"""Header and rows of a table."""
ELSEWHERE = "paper, another simulator"
"""Marks a published figure wherever one stands beside ours."""
UNPUBLISHED = "not published"
"""Stands where the paper gives no figure for a level on which it has others."""


NUMBER = re.compile(r"[<>≤≥≈~\s]*[-−+]?\.?\d")
"""What a cell with a number begins with."""


def is_published(row: list[str]) -> bool:
    """Whether a row of a table holds published figures."""
    return ELSEWHERE in row[0]


def number_columns(grid: Grid) -> list[bool]:
    """Which columns hold numbers: all but the first of which some cell begins with one, gaps being words."""
    header, rows = grid
    return [place > 0 and any(NUMBER.match(row[place]) for row in rows) for place in range(len(header))]


def plus_minus(mean: float, std: float) -> str:
    """Mean and standard deviation to two places, as in the paper."""
    return f"{mean:.2f} ± {std:.2f}"


def paper_table(results: Results) -> Grid:
    """Header and rows of the paper's table: return and cost on each level, ours and then what the paper published.

    Every algorithm of the results has a row: where there are no episodes of it, its cells say why.
    """
    cells = summaries(results.episodes)
    header = ["policy", *(f"{level} {what}" for level in results.levels for what in ("return", "cost"))]
    rows = []
    for algorithm in results.policies:
        ours = [_cell(results, algorithm, cells.get((algorithm, level))) for level in results.levels]
        rows.append([algorithm, *(text for pair in ours for text in pair)])
        published = [PUBLISHED.get((algorithm, level)) for level in results.levels]
        if any(published):
            theirs = [
                (plus_minus(cell.return_mean, cell.return_std), plus_minus(cell.cost_mean, cell.cost_std))
                if cell
                else (UNPUBLISHED, UNPUBLISHED)
                for cell in published
            ]
            rows.append([f"{algorithm} ({ELSEWHERE})", *(text for pair in theirs for text in pair)])
    return header, rows


def _cell(results: Results, algorithm: str, cell: Summary | None) -> tuple[str, str]:
    """Return and cost; the return says so where it lacks seeds."""
    if cell is None:
        return results.gap(algorithm), results.gap(algorithm)
    seeds = seeds_text(results, algorithm, cell.seeds)
    lacking = f" ({seeds} seeds)" if "of" in seeds else ""
    return plus_minus(cell.return_mean, cell.return_std) + lacking, plus_minus(cell.cost_mean, cell.cost_std)


def seeds_text(results: Results, algorithm: str, seeds: int) -> str:
    """The number of seeds of an algorithm, or `2 of 3` where some are lacking."""
    planned = results.planned_seeds(algorithm)
    return str(seeds) if seeds >= planned else f"{seeds} of {planned}"


DETAILS = (
    "policy",
    "level",
    "episodes",
    "seeds",
    "return, IQM",
    "return, IQM (bootstrap)",
    "success",
    "tight violation",
    "loose violation",
    "course flown",
    "steps",
)

EVENTS = (lambda row: row.success, lambda row: row.tight > 0, lambda row: row.loose > 0)
"""Of an episode: success, tight and loose violation."""


def detail_table(results: Results) -> Grid:
    """Header and rows of what the paper's table leaves out, one row per policy and level; intervals of 95 %."""
    cells, flown = summaries(results.episodes), grouped(results.episodes)
    rows = []
    for algorithm, level in product(results.policies, results.levels):
        cell = cells.get((algorithm, level))
        if cell is None:
            gap = results.gap(algorithm)
            rest = [gap, seeds_text(results, algorithm, 0), *[gap] * (len(DETAILS) - 4)]
        else:
            own = flown[algorithm, level]
            rest = [
                str(cell.episodes),
                seeds_text(results, algorithm, cell.seeds),
                str(middle_return(own)),
                str(bootstrapped_return(own)),
                *(share(own, holds).as_percent() for holds in EVENTS),
                f"{cell.progress_mean:.0%}",
                f"{cell.length_mean:.0f}",
            ]
        rows.append([algorithm, level, *rest])
    return list(DETAILS), rows


DETAIL_NUMBERS = ("return_iqm", "return_iqm_bootstrap", "success", "tight", "loose")
"""Each with the ends of its interval."""


def detail_csv(results: Results) -> str:
    """The details at full precision; ends of intervals that cannot be given are empty."""
    cells, flown = summaries(results.episodes), grouped(results.episodes)
    rows: list[list[object]] = []
    for algorithm, level in product(results.policies, results.levels):
        cell, planned = cells.get((algorithm, level)), results.planned_seeds(algorithm)
        if cell is None:
            rows.append([algorithm, level, 0, 0, planned, *[""] * (3 * len(DETAIL_NUMBERS) + 2)])
            continue
        own = flown[algorithm, level]
        estimates = (middle_return(own), bootstrapped_return(own), *(share(own, holds) for holds in EVENTS))
        ends = [number for estimate in estimates for number in with_ends(estimate)]
        rows.append([algorithm, level, cell.episodes, cell.seeds, planned, *ends, cell.progress_mean, cell.length_mean])
    ends = [f"{name}{end}" for name in DETAIL_NUMBERS for end in ("", "_low", "_high")]
    header = ["algorithm", "level", "episodes", "seeds", "planned_seeds", *ends, "progress_mean", "length_mean"]
    return csv_text(header, rows)


def with_ends(estimate: Estimate) -> list[object]:
    """A figure and the ends of its interval, empty where there is none."""
    ends = [estimate.low, estimate.high]
    return [estimate.value, *("" if np.isnan(end) else end for end in ends)]


def runs_table(results: Results) -> Grid:
    """Header and rows of what became of each run."""
    rows = []
    for row in results.runs:
        trained = [f"{row.steps:,}", f"{row.wall_s:,.0f}", f"{row.steps_per_s:,.0f}"]
        rows.append([row.run, row.kind, row.status, *(trained if row.kind == "train" else ["not trained"] * 3)])
    return ["run", "kind", "status", "steps", "seconds", "steps a second"], rows


def runs_csv(results: Results) -> str:
    """The runs with their errors, as they lie in the results."""
    return runs_text(results.runs)


def markdown(header: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


NUMBERS = ("return_mean", "return_std", "cost_mean", "cost_std", "success", "tight", "loose", "length_mean")


def table_csv(results: Results) -> str:
    """Every cell at full precision: one row per policy and level, the published ones marked by `source`."""
    cells = summaries(results.episodes)
    rows: list[list[object]] = []
    for algorithm, level in product(results.policies, results.levels):
        cell, planned = cells.get((algorithm, level)), results.planned_seeds(algorithm)
        blanks = [""] * (len(NUMBERS) + len(REASONS))
        numbers = [*(getattr(cell, name) for name in NUMBERS), *cell.reasons.values()] if cell else blanks
        counts = [cell.episodes, cell.seeds] if cell else [0, 0]
        rows.append(["thalweg", algorithm, level, *counts, planned, *numbers])
        if published := PUBLISHED.get((algorithm, level)):
            theirs = [published.return_mean, published.return_std, published.cost_mean, published.cost_std]
            rows.append([ELSEWHERE, algorithm, level, 60, 3, 3, *theirs, *blanks[len(theirs) :]])
    header = ["source", "algorithm", "level", "episodes", "seeds", "planned_seeds", *NUMBERS, *REASONS]
    return csv_text(header, rows)
