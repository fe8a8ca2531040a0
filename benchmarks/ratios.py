"""Rates of two sides beside each other: their ratio over the repetitions, and how rates and ratios are written."""

import statistics
from collections.abc import Sequence


def ratio(ours: Sequence[float], theirs: Sequence[float]) -> tuple[float, float, float]:
    """Return the median, least and greatest ratio of ours to theirs over the repetitions."""
    if len(ours) != len(theirs) or not len(ours):
        raise ValueError(
            f"both sides need the same number of repetitions, at least one; not {len(ours)} and {len(theirs)}"
        )
    ratios = [mine / other for mine, other in zip(ours, theirs, strict=True)]
    return statistics.median(ratios), min(ratios), max(ratios)


def number_text(value: float) -> str:
    """Return a rate or a ratio as text: two decimal places below 10, one below 100."""
    return f"{value:.2f}" if value < 10 else f"{value:.1f}" if value < 100 else f"{value:,.0f}"
