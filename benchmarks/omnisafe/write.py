"""Section of benchmarks/README.md on OmniSafe, written from the measured figures.

python -m benchmarks.omnisafe.write [--check]
"""

import json
import statistics
import sys
from pathlib import Path
from typing import Any

from benchmarks.omnisafe.compare import CURVES, HALF, OURS, PEER, SIDES, SPEED
from benchmarks.omnisafe.contests import CONTESTS, contest_named
from benchmarks.omnisafe.plot import Curves, read, read_versions
from benchmarks.page_sections import replace_section, wrap
from benchmarks.ratios import number_text, ratio
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.speed.speed_table import describe
from thalweg.core import versions

PAGE = Path(__file__).resolve().parents[1] / "README.md"
SECTION = "omnisafe"
SPEEDS = (
    "per second",
    "algorithm",
    "version",
    "OmniSafe",
    "Thalweg",
    "ratio",
    "least",
    "greatest",
    "by processor time",
    "required",
)
WORK = ("algorithm", "steps, OmniSafe", "gradient steps, OmniSafe", "steps, Thalweg", "gradient steps, Thalweg")
FINAL = (
    "algorithm",
    "version",
    "seeds",
    "return, OmniSafe",
    "return, Thalweg",
    "falls per episode, OmniSafe",
    "falls per episode, Thalweg",
    "OmniSafe's errors",
)
LAST = 0.2
"""Final returns and costs are means over this last share of the steps."""


def speed_rows(found: dict[str, Any]) -> list[list[str]]:
    """Return a row of `SPEEDS` for each algorithm that was measured, two for planners."""
    lines = {(line["algorithm"], line["side"]): line for line in found["lines"]}
    rows = []
    for contest, side in ((contest, side) for contest in CONTESTS for side in (OURS, HALF)):
        if (contest.algorithm, side) not in lines:
            continue
        theirs, ours = (lines[contest.algorithm, each] for each in (PEER, side))
        medians = (statistics.median(line["rates"]) for line in (theirs, ours))
        cells = [*medians, *ratio(ours["rates"], theirs["rates"])]
        # The time of decisions is taken by the clock alone.
        by_processor = (
            number_text(ratio(ours["by_processor"], theirs["by_processor"])[0]) if ours["by_processor"] else ""
        )
        least = "" if contest.least is None or side == HALF else f"{contest.least:g}"
        name = contest.algorithm + side.removeprefix(OURS)
        version = version_text(contest.algorithm, ours["version"])
        rows.append([contest.unit, name, version, *map(number_text, cells), by_processor, least])
    return rows


def final_means(curves: Curves, algorithm: str, side: str) -> tuple[float, float]:
    """Return the mean return and cost of the episodes in the last steps of all seeds."""
    points = [(step, numbers) for seed in curves[algorithm, side].values() for step, numbers in seed.items()]
    end = max(step for step, _ in points)
    last = [numbers for step, numbers in points if step > (1 - LAST) * end]
    episodes = sum(numbers["episodes"] for numbers in last)
    return_, cost = (sum(row[name] * row["episodes"] for row in last) / episodes for name in ("return", "cost"))
    return return_, cost


def final_rows(curves: Curves, found: dict[str, int]) -> list[list[str]]:
    """Return a row of `FINAL` for each algorithm that was trained; `found` are the versions of Thalweg's."""
    names = [contest.algorithm for contest in CONTESTS if (contest.algorithm, OURS) in curves]
    rows = []
    for name in names:
        (theirs, their_cost), (ours, our_cost) = (final_means(curves, name, side) for side in SIDES)
        cells = [f"{theirs:.2f}", f"{ours:.2f}", f"{their_cost:.3f}", f"{our_cost:.3f}"]
        seeds = min(len(curves[name, side]) for side in SIDES)
        version = version_text(name, found[name])
        rows.append([name, version, str(seeds), *cells, contest_named(name).differs])
    return rows


def version_text(algorithm: str, version: int) -> str:
    """Return the version of Thalweg's algorithm that was measured, with today's if that is another."""
    today = versions.ALGORITHMS[algorithm]
    return str(version) if version == today else f"{version} (today {today})"


def work_rows(found: dict[str, Any]) -> list[list[str]]:
    """Return a row of `WORK` for each algorithm that was measured: the work of either side in a repetition."""
    lines = {(line["algorithm"], line["side"]): line for line in found["lines"]}
    return [
        [contest.algorithm, *(cell for side in SIDES for cell in work_of(lines[contest.algorithm, side]))]
        for contest in CONTESTS
        if (contest.algorithm, OURS) in lines
    ]


def work_of(line: dict[str, Any]) -> tuple[str, str]:
    """Return the steps of a side, and its gradient steps by network."""
    counts = {
        name.removesuffix("_optimizer").strip("_") or "model": count for name, count in line["gradient_steps"].items()
    }
    return f"{line['steps']:,}", ", ".join(f"{count:,} {name}" for name, count in counts.items()) or "none"


def repetitions(found: dict[str, Any]) -> str:
    """Return how often the algorithms were measured, with those that were measured less often."""
    counts = {line["algorithm"]: len(line["rates"]) for line in found["lines"]}
    most = max(counts.values())
    fewer = [f"{name} {count}" for name, count in counts.items() if count < most]
    return f"{most} repetitions" + (f" ({', '.join(fewer)})" if fewer else "")


def section() -> str:
    """Return the section of the page, as far as it was measured."""
    parts = []
    if SPEED.exists():
        found = json.loads(SPEED.read_text())
        peer = ", ".join(f"{name} {number}" for name, number in found["peer"].items())
        note = wrap(
            f"Medians over {repetitions(found)} in turns, and the median, least and greatest of their ratios. Other "
            f"programs slow down the clock's rates, but hardly those by processor time. {describe(found)}. OmniSafe's "
            f"side: {peer}. Load of the machine before: {found['load_before']:.1f}. Versions are "
            f"those of Thalweg's algorithms. The work of one repetition:"
        )
        speeds, work = markdown(frame(SPEEDS, speed_rows(found))), markdown(frame(WORK, work_rows(found)))
        parts.append(f"{speeds}\n{note}\n{work}")
    if CURVES.exists():
        final = final_rows(read(CURVES), read_versions(CURVES))
        parts.append(
            f"{markdown(frame(FINAL, final))}\nMeans over the last {LAST:.0%} of the steps. With one "
            "seed, chance has a large effect. Versions are those of Thalweg's algorithms.\n\n"
            "![Returns and falls of both libraries by algorithm](omnisafe/curves.png)\n"
        )
    return "\n".join(parts) or "Not measured yet.\n"


def main(arguments: list[str]) -> int:
    """Write the page; with `--check`, only return 1 if it is out of date."""
    old = PAGE.read_text()
    new = replace_section(old, SECTION, section())
    if new == old:
        return 0
    if "--check" in arguments:
        print(f"stale, `python -m benchmarks.omnisafe.write` writes it: {PAGE.name}", file=sys.stderr)
        return 1
    PAGE.write_text(new)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
