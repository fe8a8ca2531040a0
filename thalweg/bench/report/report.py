"""Writes the report of a results folder: an HTML page that opens offline, with its tables, figures and films beside it.

Every number comes from the files of the results folder. The whole report is computed before any of it is written; each
file is written atomically, the page last. Other files in the folder are never touched.
"""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.report.figures import fix_layout, pdf, png
from thalweg.bench.report.films import film_files, is_film
from thalweg.bench.report.html.page import page
from thalweg.bench.report.plugins import PREFIX, is_plugin, with_plugins
from thalweg.bench.report.sections import SECTIONS, FigureSection, FilmSection, Section, TableSection
from thalweg.bench.report.table import Table, latex, markdown
from thalweg.bench.results.plugin_notes import plugin_notes
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.results import FILMS, MAIN_FILE, MAIN_FILM, Results
from thalweg.core.atomic_io import write_atomic

PAGE = "report.html"
NAMES = (*(name for section in SECTIONS if not isinstance(section, FilmSection) for name in section.files), PAGE)
"""Names of all files that a report may have, aside from films and what plug-ins add."""


@dataclass(frozen=True)
class Report:
    """Paths of a report, and its problems."""

    folder: Path
    page: Path
    table: Path
    """The paper's table as Markdown."""
    film: Path | None
    problems: tuple[str, ...]
    """What failed, is missing or was not used, one line each."""


def write_report(
    folder: Path, out: Path | None = None, *, results: Results | None = None, inline_films: bool = False
) -> Report:
    """Write the report of a results folder to `out`, or to `report` within the folder.

    Films are copied to the report and linked, or put into the page itself with `inline_films`, which then is as large
    as all of them. Raises `ResultsError` for a folder without results, and for an `out` that holds anything but an
    earlier report.
    """
    if out is not None:
        _check_out(out, folder)
    results = results or read_results(folder)
    out = out or folder / "report"
    files, found = _files(results, inline_films=inline_films)
    for name, content in files.items():
        write_atomic(out / name, content)
    for name in _earlier(out):
        if name not in files:
            (out / name).unlink(missing_ok=True)
    with suppress(OSError):  # it does not exist, or holds films
        (out / FILMS).rmdir()
    film = out / MAIN_FILE if MAIN_FILE in files else None
    return Report(out, out / PAGE, out / "table.md", film, tuple(found))


def _earlier(out: Path) -> list[str]:
    """Return the names that files of an earlier report may have in a folder."""
    plugins = [path.name for path in out.glob(f"{PREFIX}*")]
    inside = [f"{FILMS}/{path.name}" for path in (out / FILMS).glob("*")]
    return [*NAMES, *plugins, *(name for name in [*inside, *(path.name for path in out.glob("*"))] if is_film(name))]


def _check_out(out: Path, folder: Path) -> None:
    """Raise `ResultsError` unless `out` is a new folder, an empty one, or holds a report and nothing else."""
    if out.resolve() == folder.resolve():
        raise ResultsError(f"{out} holds the results themselves; give another folder for the report")
    if not out.exists():
        return
    if not out.is_dir():
        raise ResultsError(f"{out} is not a folder")
    held = [path for each in out.iterdir() for path in (each.iterdir() if _is_films(each) else [each])]
    other = sorted(name for path in held if not _is_part(name := path.relative_to(out).as_posix()))
    if other:
        more = f" and {len(other) - 3} more" if len(other) > 3 else ""
        raise ResultsError(
            f"{out} holds {', '.join(other[:3])}{more}, which is no part of a report; give an empty or a new folder"
        )


def _is_films(path: Path) -> bool:
    return path.name == FILMS and path.is_dir()


def _is_part(name: str) -> bool:
    """Return whether a file of this name is part of a report, or of one that was interrupted."""
    return name in NAMES or is_film(name) or name.startswith(PREFIX) or ".part" in name


def _files(results: Results, *, inline_films: bool) -> tuple[dict[str, bytes], list[str]]:
    """Return name and content of every file of the report, and its problems."""
    sections, tables, files, found = list[Section](), dict[str, Table](), dict[str, bytes](), problems(results)
    for section in with_plugins(SECTIONS):
        try:
            table, content = _content(section, results)
        except Exception as error:
            if not is_plugin(section):
                raise
            found.append(f"Left out: the section {section.title!r} of a plug-in: {type(error).__name__}: {error}")
            continue
        sections.append(section)
        files |= content
        if table is not None and isinstance(section, TableSection):
            tables[section.name] = table
    files |= film_files(results, (MAIN_FILM,) if inline_films else tuple(results.films))
    files[PAGE] = page(results, sections, tables, files, found, inline=inline_films).encode()
    return files, found


def _content(section: Section, results: Results) -> tuple[Table | None, dict[str, bytes]]:
    """Return the table of a section, if it is one, and the files of a table or figure; none for one that is empty."""
    if isinstance(section, TableSection):
        table = section.table(results)
        texts = () if table.text.empty else (markdown(table.text), latex(table.text), table.csv)
        return table, dict(zip(section.files, (text.encode() for text in texts), strict=False))
    if isinstance(section, FigureSection) and (figure := section.draw(results)) is not None:
        fix_layout(figure)
        return None, dict(zip(section.files, (png(figure), pdf(figure)), strict=True))
    return None, {}


def problems(results: Results) -> list[str]:
    """Return what failed, is missing or was not used, one line each."""
    lines = [f"Run {row.run} {row.status}: {row.error}" for row in results.runs if row.status != "finished"]
    for name, film in results.films.items():
        lines += [f"No film{'' if name == MAIN_FILM else f' {name}'}: {film.words}"] if film.path is None else []
    lines += plugin_notes(results)
    lines += [f"Not used: {line}" for line in results.skipped]
    lines += [f"Outdated: {name}; the suite runs it again" for name in results.outdated]
    planned = results.planned_flights
    if missing := len(planned - results.flights):
        lines.append(
            f"Unfinished: {missing} of {len(planned)} evaluations are missing; the same command resumes the suite"
        )
    return lines
