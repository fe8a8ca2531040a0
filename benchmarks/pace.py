"""Training time and learning curve of each algorithm on the river, from one run of each.

    python benchmarks/pace.py [ALGORITHM ...]
    python benchmarks/pace.py --write

Each run has 200,000 steps on Medium with the default settings and one seed, rendering included. An interrupted run
resumes; a finished one becomes a row of pace.csv and a curve of pace_curves.csv, in place of those of another version.
`--write` trains nothing: it writes the table into docs/algorithms/README.md and draws each curve for the page of its
algorithm.
"""

import argparse
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from page_sections import replace_section

from thalweg.algos.registry import ALGORITHMS, algorithm_named
from thalweg.bench.csv_files import csv_text, read_csv
from thalweg.bench.report.figures import STYLE
from thalweg.bench.report.policies import CRITICS_SEE
from thalweg.bench.report.table import frame, markdown
from thalweg.core import versions
from thalweg.core.atomic_io import atomic_path, write_atomic
from thalweg.train.folder.run_record import read_config
from thalweg.train.observations import SEEN_BY_CRITICS
from thalweg.train.river import RiverTraining, load_compatible_encoder
from thalweg.train.run import has_asymmetric_critics

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
TABLE, CURVES = HERE / "pace.csv", HERE / "pace_curves.csv"
PAGE, PICTURES = ROOT / "docs" / "algorithms" / "README.md", ROOT / "docs" / "images" / "curves"
SECTION = "pace"
STEPS, SEED, NUM_ENVS = 200_000, 0, 16
STAGES = ("act", "env", "learn", "encode", "other")
"""Stages of training: choosing actions (planning included), frames and rules, updates, the encoder, and the rest."""
CURVE_INTERVAL = 4096
"""Steps between two points of a curve."""
COLUMNS = ("algorithm", "version", "processor", "steps", "seconds", *STAGES, "return_mean_50", "cost_mean_50")
CURVE = ("algorithm", "steps", "return_mean_50", "cost_mean_50")
Rows = list[dict[str, str]]


def rows_of(path: Path, columns: tuple[str, ...]) -> Rows:
    """Return the rows of a table, or none if the file does not exist."""
    return read_csv(path, columns) if path.exists() else []


def row_of(algorithm: str, processor: str, metrics: Rows) -> dict[str, str]:
    """Return the row of a finished run of today's version: its seconds by stage, and its final return and cost."""
    made_with = {"version": str(versions.ALGORITHMS[algorithm]), "processor": processor}
    spent = {stage: f"{sum(float(row[f'time_{stage}']) for row in metrics):.1f}" for stage in STAGES}
    last = metrics[-1]
    ends = {name: f"{float(last[name]):.3f}" for name in ("return_mean_50", "cost_mean_50")}
    taken = {"steps": last["steps"], "seconds": f"{float(last['seconds']):.1f}"}
    return {"algorithm": algorithm} | made_with | taken | spent | ends


def processor_of(folder: Path) -> str:
    """Return the kind of processor of a run, and the number of its cores."""
    machine = (read_config(folder) or {})["machine"]
    return f"{machine['cpu']} ({machine['cpu_type']}), {machine['cores']} cores"


def has_row(algorithm: str) -> bool:
    """Return whether today's version of an algorithm has a row."""
    current = str(versions.ALGORITHMS[algorithm])
    return any((row["algorithm"], row["version"]) == (algorithm, current) for row in rows_of(TABLE, COLUMNS))


def curve_of(algorithm: str, metrics: Rows) -> Rows:
    """Return the first row of the log after each multiple of `CURVE_INTERVAL` steps, and the last row."""
    found: dict[int, dict[str, str]] = {}
    for row in metrics:
        found.setdefault(int(row["steps"]) // CURVE_INTERVAL, row)
    found[-1] = metrics[-1]
    rows = sorted(found.values(), key=lambda row: int(row["steps"]))
    return [
        {"algorithm": algorithm, "steps": row["steps"]} | {name: f"{float(row[name]):.3f}" for name in CURVE[2:]}
        for row in {row["steps"]: row for row in rows}.values()
    ]


def replace_rows(path: Path, columns: tuple[str, ...], algorithm: str, new: Rows) -> None:
    """Replace the rows of an algorithm in a table, which is sorted in the order of the registry."""
    others = [row for row in rows_of(path, columns) if row["algorithm"] != algorithm]
    order = list(ALGORITHMS)
    rows = sorted([*others, *new], key=lambda row: order.index(row["algorithm"]))
    write_atomic(path, csv_text(columns, ([row[name] for name in columns] for row in rows)))


def measure(algorithm: str, folder: Path) -> None:
    """Train, or resume, and write the rows of the run."""
    RiverTraining("Medium", NUM_ENVS).train(
        algorithm, load_compatible_encoder(None), steps=STEPS, seed=SEED, folder=folder
    )
    made_with = (read_config(folder) or {}).get("made_with", {}).get(algorithm)
    if made_with != versions.ALGORITHMS[algorithm]:
        raise SystemExit(
            f"{folder} holds a run of {algorithm} {made_with}, not {versions.ALGORITHMS[algorithm]}: remove it"
        )
    metrics = read_csv(folder / "metrics.csv", ("steps", "seconds", *CURVE[2:]))
    replace_rows(CURVES, CURVE, algorithm, curve_of(algorithm, metrics))
    replace_rows(TABLE, COLUMNS, algorithm, [row_of(algorithm, processor_of(folder), metrics)])


def table() -> str:
    """Return the table of the page: minutes, the share of each stage, and the processors below."""
    head = ["algorithm", CRITICS_SEE, "version", "minutes", "steps a second", *STAGES, "return", "cost"]
    lines = []
    rows = rows_of(TABLE, COLUMNS)
    for row in rows:
        seconds = float(row["seconds"])
        shares = [f"{float(row[stage]) / seconds:.0%}" for stage in STAGES]
        ends = [f"{float(row[name]):.2f}" for name in ("return_mean_50", "cost_mean_50")]
        pace = [f"{seconds / 60:.1f}", f"{float(row['steps']) / seconds:,.0f}"]
        lines.append([row["algorithm"], critics_see(row), row["version"], *pace, *shares, *ends])
    processors = dict.fromkeys(row["processor"] for row in rows)
    return f"{markdown(frame(head, lines))}\nProcessor: {'; '.join(processors)}.\n"


def critics_see(row: dict[str, str]) -> str:
    """Return what critics saw in a run with the default settings; `unknown` for one of another version."""
    entry = ALGORITHMS[row["algorithm"]]
    if row["version"] != str(versions.ALGORITHMS[entry.name]):
        return "unknown"
    return SEEN_BY_CRITICS[has_asymmetric_critics(entry.configure({}))]


def draw(algorithm: str, version: str, rows: Rows, path: Path) -> None:
    """Draw return and cost over the steps."""
    steps = [int(row["steps"]) for row in rows]
    with matplotlib.rc_context(STYLE):
        figure, axes = plt.subplots(1, 2, figsize=(6.4, 2.4))
        figure.suptitle(f"{algorithm}, version {version}, seed {SEED}")
        for axis, name, top in zip(axes, CURVE[2:], (10.0, 1.0), strict=True):
            axis.plot(steps, [float(row[name]) for row in rows], color="#1b6ca8")
            axis.set(title=f"{name.split('_')[0]}, mean of the last 50 episodes", xlabel="steps", xlim=(0, STEPS))
            axis.set_ylim(0.0, top)
            axis.xaxis.set_major_formatter(lambda steps, _: f"{steps:,.0f}")
            axis.xaxis.set_major_locator(matplotlib.ticker.MaxNLocator(4))  # pyright: ignore[reportAttributeAccessIssue]
        if hasattr(ALGORITHMS[algorithm].config, "cost_limit"):
            axes[1].axhline(0.1, color="#c0392b", linewidth=1, linestyle="--", label="limit")
            axes[1].legend(frameon=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as draft:
            figure.savefig(draft, format="png", dpi=110)
        plt.close(figure)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("algorithms", nargs="*", default=list(ALGORITHMS), help="algorithms to train; default: all")
    parser.add_argument("--out", type=Path, default=Path("results/pace"), help="folder for the runs")
    parser.add_argument("--write", action="store_true", help="train nothing, but write the page and draw the curves")
    parser.add_argument("--check", action="store_true", help="write nothing; fail if the page is out of date")
    given = parser.parse_args(arguments)
    if given.write or given.check:
        page = PAGE.read_text()
        fresh = replace_section(page, SECTION, table())
        if given.check:
            return int(fresh != page)
        write_atomic(PAGE, fresh)
        curves = rows_of(CURVES, CURVE)
        for row in rows_of(TABLE, COLUMNS):
            name = row["algorithm"]
            curve = [each for each in curves if each["algorithm"] == name]
            draw(name, row["version"], curve, PICTURES / f"{name.lower()}.png")
        return 0
    for name in given.algorithms:
        algorithm = algorithm_named(name).name
        if not has_row(algorithm):
            measure(algorithm, given.out / algorithm)
    return 0


if __name__ == "__main__":
    sys.exit(main())
