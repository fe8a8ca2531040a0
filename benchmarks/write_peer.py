"""Write the figures of `benchmarks/peer.json` into the pages, so that no figure is typed."""

import json
import statistics
import sys
from pathlib import Path

from page_sections import replace_section, wrap
from peer import COMPARED, KINDS, OURS, PEER
from ratios import number_text

from thalweg.bench.report.table import frame, markdown
from thalweg.bench.speed.speed_table import describe

ROOT = Path(__file__).resolve().parent.parent
FIGURES = ROOT / "benchmarks" / "peer.json"
SECTION = "peer"
COLUMNS = ("a second", "by", "environments", "median", "slowest", "fastest")
RATIOS = ("Thalweg beside Safety-Gymnasium", "times", "least", "greatest")


def table_rows(found: dict) -> list[list[str]]:
    """Return a row of `COLUMNS` for each measurement: kind by kind, theirs above ours."""
    order = [(kind, side) for kind in KINDS for side in (PEER, OURS)]
    lines = sorted(found["measurements"], key=lambda line: order.index((line["kind"], line["side"])))
    return [
        [
            KINDS[line["kind"]],
            line["side"],
            str(line["count"]),
            *(number_text(of(line["rates"])) for of in (statistics.median, min, max)),
        ]
        for line in lines
    ]


def ratio_rows(found: dict) -> list[list[str]]:
    """Return a row of `RATIOS` for each comparison."""
    return [
        [line["what"], *(number_text(line[key]) for key in ("ratio", "least", "greatest"))]
        for line in found["comparisons"]
    ]


def section(found: dict) -> str:
    """Return the section of `benchmarks/README.md`."""
    resets = {line["side"]: line["reset_s"] for line in found["measurements"] if line["kind"] == "one"}
    peer = ", ".join(f"{name} {found['peer'][name]}" for name in ("safety-gymnasium", "mujoco", "python"))
    repeats = len(found["measurements"][0]["rates"])
    how = wrap(
        f"{repeats} repetitions of {found['seconds']:g} s each, in turns; a ratio is the median over them, with the "
        f"least and the greatest. {describe(found)}. The peer: {peer}; `{found['opengl']}`. A reset, left out for the "
        f"peer alone, takes it {resets[PEER] * 1e3:,.0f} ms, Thalweg {resets[OURS] * 1e3:,.0f} ms. Load of the machine "
        f"before: {found['load_before']:.1f}."
    )
    return (
        f"{markdown(frame(RATIOS, ratio_rows(found)))}\n{markdown(frame(COLUMNS, table_rows(found)))}\n{how}\n"
        "![Starts of episodes: Safety-Gymnasium above, Thalweg below](peer.png)\n"
    )


def sentence(found: dict) -> str:
    """Return the section of `docs/render.md`."""
    by_name = {line["what"]: line for line in found["comparisons"]}
    one, best, frame = (
        f"{number_text(line['ratio'])} times ({number_text(line['least'])} to {number_text(line['greatest'])})"
        for line in (by_name[name] for name in COMPARED)
    )
    size, cores = found["size"], found["machine"]["cores"]
    return wrap(
        f"Beside Safety-Gymnasium's vision task, both {size} x {size} on the processor, {cores} cores, in one run: "
        f"{one} its steps a second with one environment each, {best} with each side at its fastest, {frame} its frames "
        "alone ([how, and the figures](../benchmarks/README.md#beside-safety-gymnasium))."
    )


PAGES = {ROOT / "benchmarks" / "README.md": section, ROOT / "docs" / "render.md": sentence}


def main(arguments: list[str]) -> int:
    """Write the pages; with `--check`, only return 1 if they are out of date."""
    found = json.loads(FIGURES.read_text()) if FIGURES.exists() else None
    stale = []
    for page, compute in PAGES.items():
        old = page.read_text()
        new = replace_section(old, SECTION, compute(found) if found else "Not measured yet.\n")
        if new != old:
            stale.append(page.name)
            if "--check" not in arguments:
                page.write_text(new)
    if stale and "--check" in arguments:
        print(f"stale, `python benchmarks/write_peer.py` writes them: {', '.join(stale)}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
