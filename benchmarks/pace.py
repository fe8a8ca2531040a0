"""Training time and learning curve of each algorithm on the river, from one run of each.

    python benchmarks/pace.py [ALGORITHM ...]
    python benchmarks/pace.py --write

Each run has 200,000 steps on Medium with the default settings and one seed, rendering included. An interrupted run
resumes; a finished one becomes a row of pace.csv and a curve of pace_curves.csv, in place of those of other versions.
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
from tables import Rows, of_versions, put, rows_of, thinned

from thalweg.algos.registry import ALGORITHMS, algorithm_named
from thalweg.bench.csv_files import read_csv
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
COLUMNS = (
    *("algorithm", "version", "processor", "steps", "seconds", *STAGES, "return_mean_50", "cost_mean_50"),
    *("training", "world", "render", "rules", "encoder"),
)
CURVE = ("algorithm", "steps", "return_mean_50", "cost_mean_50")


def versions_of(algorithm: str) -> dict[str, str]:
    """Return today's versions of what a run depends on, by their columns."""
    shared = {
        "training": versions.TRAINING,
        "world": versions.WORLD,
        "render": versions.RENDER,
        "rules": versions.RULES,
        "encoder": versions.PACKAGED_ENCODER,
    }
    return {name: str(number) for name, number in ({"version": versions.ALGORITHMS[algorithm]} | shared).items()}


def row_of(algorithm: str, processor: str, metrics: Rows) -> dict[str, str]:
    """Return the row of a finished run of today's versions: its seconds by stage, and its final return and cost."""
    made_with = versions_of(algorithm) | {"processor": processor}
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
    """Return whether an algorithm has a row of today's versions."""
    return bool(of_versions(rows_of(TABLE, COLUMNS), versions_of(algorithm) | {"algorithm": algorithm}))


def curve_of(algorithm: str, metrics: Rows) -> Rows:
    """Return the first row of the log after each multiple of `CURVE_INTERVAL` steps, and the last row."""
    return [
        {"algorithm": algorithm, "steps": row["steps"]} | {name: f"{float(row[name]):.3f}" for name in CURVE[2:]}
        for row in thinned(metrics, CURVE_INTERVAL)
    ]


def replace_rows(path: Path, columns: tuple[str, ...], new: Rows) -> None:
    """Put the rows of an algorithm into a table in place of its others; it is sorted in the order of the registry."""
    put(path, columns, new, ("algorithm",), lambda row: list(ALGORITHMS).index(row["algorithm"]))


def measure(algorithm: str, folder: Path) -> None:
    """Train, or resume, and write the rows of the run."""
    RiverTraining("Medium", NUM_ENVS).train(
        algorithm, load_compatible_encoder(None), steps=STEPS, seed=SEED, folder=folder
    )
    made_with, today = (read_config(folder) or {}).get("made_with", {}), versions_of(algorithm)
    for name, column in ((algorithm, "version"), *((each, each) for each in ("training", "world", "rules"))):
        if str(made_with.get(name)) != today[column]:
            raise SystemExit(f"{folder} holds a run of {name} {made_with.get(name)}, not {today[column]}: remove it")
    metrics = read_csv(folder / "metrics.csv", ("steps", "seconds", *CURVE[2:]))
    replace_rows(CURVES, CURVE, curve_of(algorithm, metrics))
    replace_rows(TABLE, COLUMNS, [row_of(algorithm, processor_of(folder), metrics)])


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
