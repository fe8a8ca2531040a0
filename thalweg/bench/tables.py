"""How do the figures stand beside one another? The paper's table with ours above each published row, as text."""

from thalweg.bench.episodes import REASONS
from thalweg.bench.files import csv_text
from thalweg.bench.published import PUBLISHED
from thalweg.bench.results import Results
from thalweg.bench.statistics import Summary, summaries

ELSEWHERE = "paper, another simulator"
"""Marks a published figure wherever one stands beside ours."""


def plus_minus(mean: float, std: float) -> str:
    """Mean and standard deviation to two places, as in the paper."""
    return f"{mean:.2f} ± {std:.2f}"


def paper_table(results: Results, *, with_published: bool = True) -> tuple[list[str], list[list[str]]]:
    """Header and rows of the paper's table: return and cost on each level, ours and then what the paper published."""
    cells = summaries(results.episodes)
    header = ["policy", *(f"{level} {what}" for level in results.levels for what in ("return", "cost"))]
    rows = []
    for algorithm in dict.fromkeys(algorithm for algorithm, _ in cells):
        ours = [_cell(cells.get((algorithm, level))) for level in results.levels]
        rows.append([algorithm, *(text for pair in ours for text in pair)])
        published = [PUBLISHED.get((algorithm, level)) for level in results.levels]
        if with_published and any(published):
            theirs = [
                (plus_minus(cell.return_mean, cell.return_std), plus_minus(cell.cost_mean, cell.cost_std))
                if cell
                else ("", "")
                for cell in published
            ]
            rows.append([f"{algorithm} ({ELSEWHERE})", *(text for pair in theirs for text in pair)])
    return header, rows


def _cell(cell: Summary | None) -> tuple[str, str]:
    if cell is None:
        return "missing", "missing"
    return plus_minus(cell.return_mean, cell.return_std), plus_minus(cell.cost_mean, cell.cost_std)


def detail_table(results: Results) -> tuple[list[str], list[list[str]]]:
    """Header and rows of what the paper's table leaves out, one row per policy and level."""
    header = [
        "policy",
        "level",
        "episodes",
        "seeds",
        "success",
        "tight violation",
        "loose violation",
        "course flown",
        "steps",
    ]
    rows = [
        [
            algorithm,
            level,
            str(cell.episodes),
            str(cell.seeds),
            f"{cell.success:.0%}",
            f"{cell.tight:.0%}",
            f"{cell.loose:.0%}",
            f"{cell.progress_mean:.0%}",
            f"{cell.length_mean:.0f}",
        ]
        for (algorithm, level), cell in summaries(results.episodes).items()
    ]
    return header, rows


def markdown(header: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


NUMBERS = ("return_mean", "return_std", "cost_mean", "cost_std", "success", "tight", "loose", "length_mean")


def table_csv(results: Results) -> str:
    """Every cell at full precision: one row per policy and level, the published ones marked by `source`."""
    rows: list[list[object]] = []
    for (algorithm, level), cell in summaries(results.episodes).items():
        numbers = [getattr(cell, name) for name in NUMBERS]
        rows.append(["thalweg", algorithm, level, cell.episodes, cell.seeds, *numbers, *cell.reasons.values()])
        if published := PUBLISHED.get((algorithm, level)):
            theirs = [published.return_mean, published.return_std, published.cost_mean, published.cost_std]
            blanks = [""] * (len(NUMBERS) - len(theirs) + len(cell.reasons))
            rows.append([ELSEWHERE, algorithm, level, 60, 3, *theirs, *blanks])
    return csv_text(["source", "algorithm", "level", "episodes", "seeds", *NUMBERS, *REASONS], rows)
