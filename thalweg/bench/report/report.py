"""What does one hand on? One HTML page that opens without a network, and beside it its tables, pictures and film.

Every number comes from the files of the results folder. All of the report is made before any of it is written, each
file whole or not at all, the page last; what else lies in its folder is never touched.
"""

from dataclasses import dataclass
from pathlib import Path

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.report.figures import arrange, pdf, png
from thalweg.bench.report.latex import latex
from thalweg.bench.report.page import page
from thalweg.bench.report.sections import PARTS, Picture, Table
from thalweg.bench.report.tables import markdown
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.results import MAIN_FILE, MAIN_FILM, Results
from thalweg.core.atomic_io import write_atomic

PAGE = "report.html"
NAMES = (*(name for part in PARTS for name in part.files), PAGE)
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
        write_atomic(out / name, content)
    for name in NAMES:
        if name not in files:
            (out / name).unlink(missing_ok=True)
    film = out / MAIN_FILE if MAIN_FILE in files else None
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
    grids = {part.name: part.text(results) for part in PARTS if isinstance(part, Table)}
    files: dict[str, bytes] = {}
    for part in PARTS:
        if isinstance(part, Table) and grids[part.name][1]:
            grid = grids[part.name]
            texts = (markdown(*grid), latex(*grid), part.csv(results))
            files.update(zip(part.files, (text.encode() for text in texts), strict=True))
        elif isinstance(part, Picture) and (figure := part.draw(results)) is not None:
            arrange(figure)
            files.update(zip(part.files, (png(figure), pdf(figure)), strict=True))
    if (film := results.films.get(MAIN_FILM)) is not None and film.path is not None:
        files[MAIN_FILE] = film.path.read_bytes()
    files[PAGE] = page(results, grids, files, problems(results)).encode()
    return files


def problems(results: Results) -> list[str]:
    """What failed, is missing or was not used, a line each."""
    lines = [f"Run {row.run} {row.status}: {row.error}" for row in results.runs if row.status != "finished"]
    for name, film in results.films.items():
        lines += [f"No film{'' if name == MAIN_FILM else f' {name}'}: {film.words}"] if film.path is None else []
    lines += [f"Not used: {line}" for line in results.skipped]
    planned = results.planned_flights
    if missing := len(planned - results.flights):
        lines.append(f"Unfinished: {missing} of {len(planned)} evaluations are missing; the suite goes on with them")
    return lines
