"""Writes the comparison with OmniSafe into benchmarks/README.md, between its marks, so that no figure is typed.

python -m benchmarks.omnisafe.write [--check]
"""

import json
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.marks import between_marks, prose
from benchmarks.omnisafe.compare import CURVES, HALF, OURS, PEER, SIDES, SPEED
from benchmarks.omnisafe.contests import CONTESTS, contest_named
from benchmarks.omnisafe.plot import Curves, read
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.speed.speed_table import describe

PAGE = Path(__file__).resolve().parents[1] / "README.md"
MARK = "omnisafe"
SPEEDS = ("a second", "of", "OmniSafe", "Thalweg", "times", "least", "greatest", "by processor time", "asked for")
WORK = ("of", "steps, OmniSafe", "gradient steps, OmniSafe", "steps, Thalweg", "gradient steps, Thalweg")
LEARNT = (
    "learnt",
    "seeds",
    "return, OmniSafe",
    "return, Thalweg",
    "falls, OmniSafe",
    "falls, Thalweg",
    "OmniSafe's errors",
)
LAST = 0.2
"""What was learnt is the mean over this share of the steps, the last."""


def shown(value: float) -> str:
    """A rate or a ratio: two places below 10, one below 100."""
    return f"{value:.2f}" if value < 10 else f"{value:.1f}" if value < 100 else f"{value:,.0f}"


def ratio(ours: Sequence[float], theirs: Sequence[float]) -> tuple[float, float, float]:
    """How many times theirs ours is: median, least and greatest of the repetitions, each by itself."""
    found = [mine / other for mine, other in zip(ours, theirs, strict=True)]
    return statistics.median(found), min(found), max(found)


def speed_rows(found: dict[str, Any]) -> list[list[str]]:
    """A row for each algorithm that was measured, of planners two, in the order of `SPEEDS`."""
    lines = {(line["algorithm"], line["side"]): line for line in found["lines"]}
    rows = []
    for contest, side in ((contest, side) for contest in CONTESTS for side in (OURS, HALF)):
        if (contest.algorithm, side) not in lines:
            continue
        theirs, ours = (lines[contest.algorithm, each] for each in (PEER, side))
        medians = (statistics.median(line["rates"]) for line in (theirs, ours))
        cells = [*medians, *ratio(ours["rates"], theirs["rates"])]
        # The time of decisions is taken by the clock alone.
        by_processor = shown(ratio(ours["by_processor"], theirs["by_processor"])[0]) if ours["by_processor"] else ""
        least = "" if contest.least is None or side == HALF else f"{contest.least:g}"
        name = contest.algorithm + side.removeprefix(OURS)
        rows.append([contest.unit, name, *map(shown, cells), by_processor, least])
    return rows


def learnt(curves: Curves, algorithm: str, side: str) -> tuple[float, float]:
    """Mean return and cost of the episodes in the last part of all seeds."""
    points = [(step, numbers) for seed in curves[algorithm, side].values() for step, numbers in seed.items()]
    end = max(step for step, _ in points)
    last = [numbers for step, numbers in points if step > (1 - LAST) * end]
    episodes = sum(numbers["episodes"] for numbers in last)
    paid, cost = (sum(one[name] * one["episodes"] for one in last) / episodes for name in ("return", "cost"))
    return paid, cost


def learnt_rows(curves: Curves) -> list[list[str]]:
    """A row for each algorithm that was trained, in the order of `LEARNT`."""
    names = [contest.algorithm for contest in CONTESTS if (contest.algorithm, OURS) in curves]
    rows = []
    for name in names:
        (theirs, their_cost), (ours, our_cost) = (learnt(curves, name, side) for side in SIDES)
        cells = [f"{theirs:.2f}", f"{ours:.2f}", f"{their_cost:.3f}", f"{our_cost:.3f}"]
        seeds = min(len(curves[name, side]) for side in SIDES)
        rows.append([name, str(seeds), *cells, contest_named(name).differs])
    return rows


def work_rows(found: dict[str, Any]) -> list[list[str]]:
    """How much either side did in a repetition, a row for each algorithm that was measured, in the order of `WORK`."""
    lines = {(line["algorithm"], line["side"]): line for line in found["lines"]}
    return [
        [contest.algorithm, *(cell for side in SIDES for cell in work_of(lines[contest.algorithm, side]))]
        for contest in CONTESTS
        if (contest.algorithm, OURS) in lines
    ]


def work_of(line: dict[str, Any]) -> tuple[str, str]:
    """Steps of a side, and its gradient steps by what they were of."""
    counts = {
        name.removesuffix("_optimizer").strip("_") or "model": count for name, count in line["gradient_steps"].items()
    }
    return f"{line['steps']:,}", ", ".join(f"{count:,} {name}" for name, count in counts.items()) or "none"


def section() -> str:
    """What the page says, of as much as was measured."""
    parts = []
    if SPEED.exists():
        found = json.loads(SPEED.read_text())
        peer = ", ".join(f"{name} {number}" for name, number in found["peer"].items())
        repeats = len(found["lines"][0]["rates"])
        said = prose(
            f"{repeats} repetitions in turns: medians, and the median, least and greatest of their ratios; other "
            f"programs take their share of a second, not of a second of the processor. {describe(found)}. The peer: "
            f"{peer}. Load of the machine before: {found['load_before']:.1f}. What a repetition was:"
        )
        speeds, work = markdown(frame(SPEEDS, speed_rows(found))), markdown(frame(WORK, work_rows(found)))
        parts.append(f"{speeds}\n{said}\n{work}")
    if CURVES.exists():
        curves = read(CURVES)
        parts.append(
            f"{markdown(frame(LEARNT, learnt_rows(curves)))}\nMeans over the last {LAST:.0%} of the steps; of one seed "
            "chance is large.\n\n![Returns and falls of both, algorithm by algorithm](omnisafe/curves.png)\n"
        )
    return "\n".join(parts) or "Not measured yet.\n"


def main(arguments: list[str]) -> int:
    """Write the page; with `--check` only say by the exit status whether it is up to date."""
    old = PAGE.read_text()
    new = between_marks(old, MARK, section())
    if new == old:
        return 0
    if "--check" in arguments:
        print(f"stale, `python -m benchmarks.omnisafe.write` writes it: {PAGE.name}", file=sys.stderr)
        return 1
    PAGE.write_text(new)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
