"""The tables of the shield's page, from the rows of today's versions and policies."""

from collections.abc import Iterable, Mapping
from math import sqrt

from shield_arms import KINDS, LEVELS, VERSIONS

from thalweg.bench.evaluate.episodes import REASON_TEXT, REASONS
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.results.inference import Estimate, wilson_interval
from thalweg.env.shield.moves import VERDICTS

SIDES = ("without", "with")
VETOED = VERDICTS[1:]
Row = Mapping[str, str]


def page_tables(rows: Iterable[Row], names: Mapping[str, str]) -> str:
    """Return the tables of the page: returns, violations and vetoes, and how flights end.

    `names`: of today's policies, by what made them; rows of other policies are left out.
    """
    rows = current_rows(rows, names)
    lines = [[_policy(row, names), f"{row['kind']}, {row['level']}"] for row in rows]
    both = (
        (FIGURES, [_figures(row) for row in rows]),
        ([REASON_TEXT[reason] for reason in REASONS], [_ends(row) for row in rows]),
    )
    tables = [
        frame(["policy", "river", *columns], [line + cells for line, cells in zip(lines, of_rows, strict=True)])
        for columns, of_rows in both
    ]
    return "\n\n".join(markdown(table).rstrip() for table in tables)


def current_rows(rows: Iterable[Row], names: Mapping[str, str]) -> list[Row]:
    """Return the rows of today's versions and policies, in the order of `names`; of the same flights, those of the most
    episodes."""
    found: dict[tuple[str, ...], Row] = {}
    for row in rows:
        if row["made_by"] not in names or any(row[name] != str(version) for name, version in VERSIONS.items()):
            continue
        same = (*(row[name] for name in ("made_by", "settings", "kind", "level")),)
        if same not in found or int(found[same]["episodes"]) < int(row["episodes"]):
            found[same] = row
    order = list(names)

    def place(row: Row) -> tuple[int, str, int, int]:
        return order.index(row["made_by"]), row["settings"], KINDS.index(row["kind"]), LEVELS.index(row["level"])

    return sorted(found.values(), key=place)


def _policy(row: Row, names: Mapping[str, str]) -> str:
    """Return the policy of a row in words, with the shield's settings that differ from its defaults."""
    return ", ".join(filter(None, (names[row["made_by"]], row["settings"])))


FIGURES = (
    *("flights", "return", "violations", "difference, points", "cost"),
    *("helped", "harmed", "vetoed", "of these permitted", "ms"),
)
"""Columns of the first table behind policy and river."""


def _figures(row: Row) -> list[str]:
    """Return the cells of `FIGURES`."""
    difference = violations_difference(row)
    points = (100 * end for end in (difference.value, difference.low, difference.high))
    return [
        row["episodes"],
        _change(row, "return", ".2f"),
        _change(row, "violations", ".0%"),
        "{:.1f} [{:.1f}, {:.1f}]".format(*points),
        _change(row, "cost", ".2f"),
        row["helped"],
        row["harmed"],
        f"{_vetoes(row) / int(row['steps']):.1%}",
        f"{_vetoes(row, 'false_') / max(_vetoes(row), 1):.0%}",
        f"{float(row['ms_a_step']):.2f}",
    ]


def violations_difference(row: Row) -> Estimate:
    """Return the share of flights with violations with the shield minus that without it."""
    count, helped, harmed = (int(row[name]) for name in ("episodes", "helped", "harmed"))
    both = round(count * float(row["violations_without"])) - helped
    return paired_difference_of_shares(both, harmed, helped, count - both - harmed - helped)


def paired_difference_of_shares(both: int, first: int, second: int, neither: int) -> Estimate:
    """Return the difference of two shares, first minus second, of the same trials, with its 95 % interval.

    Counts are of trials that hold on both sides, on the first alone, on the second alone, and on neither. The interval
    combines Wilson's of either share, and contracts with their correlation φ: method 10 of Newcombe (1998), "Improved
    confidence intervals for the difference between binomial proportions based on paired data". It has a width where no
    trial differs.
    """
    count = both + first + second + neither
    p, q = (both + first) / count, (both + second) / count
    (p_low, p_high), (q_low, q_high) = wilson_interval(p, count), wilson_interval(q, count)
    product = both * neither - first * second
    if product > 0:
        product = max(product - count / 2, 0.0)
    marginals = (both + first) * (second + neither) * (both + second) * (first + neither)
    phi = product / sqrt(marginals) if marginals else 0.0
    below = _combined(p - p_low, q_high - q, phi)
    above = _combined(p_high - p, q - q_low, phi)
    return Estimate(p - q, p - q - below, p - q + above)


def _combined(one: float, other: float, phi: float) -> float:
    """Return sqrt(one² - 2 φ one other + other²), which rounding may put below zero."""
    return sqrt(max(one**2 - 2 * phi * one * other + other**2, 0.0))


def _change(row: Row, name: str, digits: str) -> str:
    """Return a figure without and with the shield."""
    return " → ".join(format(float(row[f"{name}_{side}"]), digits) for side in SIDES)


def _ends(row: Row) -> list[str]:
    """Return for each reason how many flights end for it, without and with the shield."""
    counts = [dict(pair.split("=") for pair in row[f"reasons_{side}"].split()) for side in SIDES]
    return [" → ".join(of_side.get(reason, "0") for of_side in counts) for reason in REASONS]


def _vetoes(row: Row, prefix: str = "") -> int:
    """Return how many moves were vetoed, or of these, with `false_`, were permitted by the rules."""
    return sum(int(row[prefix + name.replace(" ", "_")]) for name in VETOED)
