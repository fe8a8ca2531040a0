"""What does one hand on? One HTML page that opens without a network, and its tables and pictures as files beside it.

Every number comes from the files of the results folder. All of the report is made before any of it is written, each
file whole or not at all, the page last; what else lies in its folder is never touched.
"""

import base64
import html
import json
from dataclasses import dataclass
from pathlib import Path
from string import Template

from thalweg.bench import figures, tables
from thalweg.bench.files import ResultsError
from thalweg.bench.published import SOURCE
from thalweg.bench.results import CAPTION, FILM, Results, read_results
from thalweg.bench.suites import arms_of
from thalweg.whole import write_whole

TEMPLATE = Template((Path(__file__).with_name("page.html")).read_text(encoding="utf-8"))
PAGE = "report.html"
NAMES = ("table.md", "table.csv", "failures.png", "curves.png", FILM, PAGE)
"""All that a report may consist of."""


@dataclass(frozen=True)
class Report:
    """Where the parts of a report lie."""

    folder: Path
    page: Path
    table: Path
    """The paper's table as Markdown."""
    film: Path | None
    problems: tuple[str, ...]
    """What failed, is missing or was not used, a line each."""


def write_report(folder: Path, out: Path | None = None) -> Report:
    """Make the report of a results folder, in `out` or in `report` within it.

    Raises `ResultsError` for a folder without results, and for an `out` that holds anything but an earlier report.
    """
    if out is not None:
        _check_place(out, folder)
    results = read_results(folder)
    out = out or folder / "report"
    files = _files(results)
    for name, content in files.items():
        write_whole(out / name, content)
    for name in NAMES:
        if name not in files:
            (out / name).unlink(missing_ok=True)
    film = out / FILM if FILM in files else None
    return Report(out, out / PAGE, out / "table.md", film, tuple(problems(results)))


def _check_place(out: Path, folder: Path) -> None:
    """Raise `ResultsError` unless `out` is a new folder, an empty one, or holds a report and nothing else."""
    if out.resolve() == folder.resolve():
        raise ResultsError(f"{out} holds the results themselves; give a folder of its own for the report")
    if not out.exists():
        return
    if not out.is_dir():
        raise ResultsError(f"{out} is not a folder")
    other = sorted(file.name for file in out.iterdir() if file.name not in NAMES and ".part" not in file.name)
    if other:
        more = f" and {len(other) - 3} more" if len(other) > 3 else ""
        raise ResultsError(
            f"{out} holds {', '.join(other[:3])}{more}, which is no part of a report; give a folder of its own"
        )


def _files(results: Results) -> dict[str, bytes]:
    """Name and content of everything in the report."""
    curves = figures.training_curves(results)
    film = results.folder / FILM
    files = {
        "table.md": tables.markdown(*tables.paper_table(results)).encode(),
        "table.csv": tables.table_csv(results).encode(),
        "failures.png": figures.png(figures.failure_bars(results)),
    }
    if curves is not None:
        files["curves.png"] = figures.png(curves)
    if film.exists():
        files[FILM] = film.read_bytes()
    files[PAGE] = _page(results, files).encode()
    return files


def problems(results: Results) -> list[str]:
    """What failed, is missing or was not used, a line each."""
    lines = [f"Run {row.run} {row.status}: {row.error}" for row in results.runs if row.status != "finished"]
    lines += [f"No film: {results.no_film}"] if results.no_film else []
    lines += [f"Not used: {line}" for line in results.skipped]
    planned = results.planned_flights
    if missing := len(planned - results.flights):
        lines.append(f"Unfinished: {missing} of {len(planned)} evaluations are missing; the suite goes on with them")
    return lines


def _page(results: Results, files: dict[str, bytes]) -> str:
    suite = results.suite
    return TEMPLATE.substitute(
        title=html.escape(f"Thalweg: suite {suite.get('name', 'unknown')}"),
        intro=_intro(results),
        table=html_table(*tables.paper_table(results), marked=tables.ELSEWHERE),
        source=html.escape(SOURCE),
        film=_film(files.get(FILM), _caption(results)),
        curves=_picture(files.get("curves.png"), _curves_alt(results))
        or "<p>Nothing was trained in these results.</p>",
        failures=_picture(
            files["failures.png"], "Bars: the share of episodes that ended for each reason, by policy and level."
        ),
        details=html_table(*tables.detail_table(results)),
        runs=_runs(results),
        problems=_problems(problems(results)),
        record=html.escape(json.dumps(suite, indent=2)),
    )


def _intro(results: Results) -> str:
    suite = results.suite
    trained = [row for row in results.runs if row.kind == "train"]
    parts = [f"{len(results.episodes)} evaluated episodes on {', '.join(results.levels)}."]
    if trained and suite:
        steps = sorted({arm["steps"] for arm in arms_of(suite)})
        seeds = max(len(arm["seeds"]) for arm in arms_of(suite))
        parts.append(
            f"{len(trained)} training runs of {' or '.join(f'{count:,}' for count in steps)} steps on"
            f" {suite['train_level']} ({seeds} seed{'s' * (seeds > 1)})."
        )
        if steps[-1] < 200_000:
            parts.append(
                "This is far shorter than the paper's 200,000 steps: it shows that everything runs, not who is better."
            )
    return html.escape(" ".join(parts))


def html_table(header: list[str], rows: list[list[str]], marked: str = "") -> str:
    """A table in HTML; rows whose first cell has `marked` in it are set apart."""
    head = "".join(f"<th scope='col'>{html.escape(cell)}</th>" for cell in header)
    body = []
    for first, *rest in rows:
        kind = " class='elsewhere'" if marked and marked in first else ""
        cells = "".join(f"<td>{html.escape(cell)}</td>" for cell in rest)
        body.append(f"<tr{kind}><th scope='row'>{html.escape(first)}</th>{cells}</tr>")
    return f"<div class='wide'><table><thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table></div>"


def _picture(content: bytes | None, text: str) -> str:
    if content is None:
        return ""
    return (
        f"<img src='data:image/png;base64,{base64.b64encode(content).decode()}' alt='{html.escape(text, quote=True)}'>"
    )


def _film(content: bytes | None, caption: str) -> str:
    if content is None:
        return "<p>These results hold no film.</p>"
    data = base64.b64encode(content).decode()
    return (
        f"<figure><video controls muted loop playsinline src='data:video/mp4;base64,{data}'"
        f" aria-label='Film of a flight'></video><figcaption>{html.escape(caption)}</figcaption></figure>"
    )


def _caption(results: Results) -> str:
    path = results.folder / CAPTION
    return path.read_text(encoding="utf-8").strip() if path.exists() else ""


def _curves_alt(results: Results) -> str:
    names = ", ".join(dict.fromkeys(log.algorithm for log in results.training))
    return (
        f"Four curves over the steps of training for {names}: return, and violations per step in all, tight and loose."
    )


def _runs(results: Results) -> str:
    rows = []
    for row in results.runs:
        trained = [f"{row.steps:,}", f"{row.wall_s:.0f}", f"{row.steps_per_s:.0f}"]
        rows.append([row.run, row.kind, row.status, *(trained if row.kind == "train" else ["not trained"] * 3)])
    return html_table(["run", "kind", "status", "steps", "seconds", "steps a second"], rows)


def _problems(lines: list[str]) -> str:
    if not lines:
        return ""
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    return f"<section class='problems'><h2>Failed, missing or not used</h2><ul>{items}</ul></section>"
