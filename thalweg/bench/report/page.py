"""The HTML page of a report, which loads nothing from elsewhere.

Its Jinja2 template is `page.html`, its style `page.css` and its script `page.js`. The page is complete without the
script, which sorts and filters the tables.
"""

import base64
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from thalweg.bench.report.sections import FigureSection, FilmSection, Section, TableSection
from thalweg.bench.report.table import Table, is_published, numeric_columns
from thalweg.bench.results.results import Results
from thalweg.bench.suite.record import arms_of, rules_in_words
from thalweg.train.observations import FRAMES, PRIVILEGED

HERE = Path(__file__).parent
PAPER_STEPS = 200_000
"""Training steps of the paper's runs."""


def data_uri(content: bytes, media_type: str) -> str:
    """Return the content as a `data:` URI."""
    return f"data:{media_type};base64,{base64.b64encode(content).decode()}"


TEMPLATES = Environment(
    loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
)
TEMPLATES.filters["data_uri"] = data_uri
STYLE, SCRIPT = (Markup((HERE / name).read_text(encoding="utf-8")) for name in ("page.css", "page.js"))


def page(
    results: Results,
    sections: Sequence[Section],
    tables: Mapping[str, Table],
    files: Mapping[str, bytes],
    problems: Sequence[str],
) -> str:
    """Return the page of some results: its `sections` with their `tables`, the `files` beside it by name, and the
    `problems` as text."""
    suite = results.suite
    contents = (content for section in sections for content in _contents(section, results, tables, files))
    return TEMPLATES.get_template("page.html").render(
        title=f"Thalweg: suite {suite.get('name', 'unknown')}",
        style=STYLE,
        script=SCRIPT,
        introduction=_introduction(results),
        problems=problems,
        levels=json.dumps(results.levels),
        sections=contents,
        suite=json.dumps(suite, indent=2),
        files=list(files),
    )


def _introduction(results: Results) -> str:
    """Return the introductory sentences: what was trained and evaluated."""
    arms = arms_of(results.suite)
    trained = [row for row in results.runs if row.kind == "train"]
    sentences = [f"{len(results.episodes)} evaluated episodes on {', '.join(results.levels)}."]
    if trained and arms:
        steps = sorted({arm["steps"] for arm in arms})
        seeds = max(len(arm["seeds"]) for arm in arms)
        levels = dict.fromkeys(arm.get("level") or results.suite["train_level"] for arm in arms)
        sentences.append(
            f"{len(trained)} training runs of {' or '.join(f'{count:,}' for count in steps)} steps on"
            f" {' or '.join(levels)} ({seeds} seed{'s' * (seeds > 1)})."
        )
        if steps[-1] < PAPER_STEPS:
            sentences.append(
                f"This is far fewer than the paper's {PAPER_STEPS:,} steps: it shows that everything runs, not which"
                " policy is better."
            )
    rules = rules_in_words(results.suite)
    return " ".join([*sentences, *([rules] if rules else []), *_observations(results)])


def _observations(results: Results) -> Iterator[str]:
    """Sentences on what policies see, except for codes of frames, and on critics that see more."""
    seen = results.observations
    for observation in sorted({*seen.values()} - {FRAMES}):
        named = [name for name, each in seen.items() if each == observation]
        who = "The trained policies" if len(named) == len(seen) else ", ".join(named)
        what = f"images ({observation}) instead of codes of frames"
        if observation == PRIVILEGED:
            what = "what a perfect camera could tell (the privileged observation) instead of frames"
        yield f"{who} see {what}."
    if told := results.with_asymmetric_critics:
        which = "all policies" if len(told) == len(seen) else ", ".join(told)
        yield f"In training, the critics of {which} also saw the privileged state and progress."


def _contents(
    section: Section, results: Results, tables: Mapping[str, Table], files: Mapping[str, bytes]
) -> Iterator[dict[str, Any]]:
    """What the template shows of a section; nothing for one that is empty and has no fallback."""
    content: dict[str, Any] = {}
    if isinstance(section, TableSection):
        content = _table(tables[section.name])
    elif isinstance(section, FigureSection):
        if (image := files.get(f"{section.name}.png")) is not None:
            content = {"image": image, "description": section.description(results)}
    elif films := _films(section, results):
        content = {"films": films}
    if content or section.fallback:
        heading = {"title": section.title, "note": section.note, "fallback": section.fallback}
        yield dict.fromkeys(("columns", "image", "films")) | heading | content


def _table(table: Table) -> dict[str, Any]:
    """Return columns and rows of a table; a column with whether it is numeric, a row with whether it is published."""
    if table.text.empty:
        return {}
    rows = table.text.itertuples(index=False, name=None)
    return {
        "columns": list(zip(table.text.columns, numeric_columns(table.text), strict=True)),
        "rows": [(row, is_published(row[0])) for row in rows],
    }


def _films(section: FilmSection, results: Results) -> list[dict[str, Any]]:
    """Return the films of a section, each with its label and its caption."""
    films = []
    for name, film in results.films.items():
        if section.includes(name) and film.path is not None:
            policy, _, kind = name.rpartition("/")[2].rpartition("-")
            label = "Film of a flight" + (f": {policy}, {kind}" if policy else "")
            poster = film.poster.read_bytes() if film.poster else None
            films.append({"content": film.path.read_bytes(), "poster": poster, "label": label, "caption": film.words})
    return films
