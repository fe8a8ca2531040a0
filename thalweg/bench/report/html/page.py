"""The HTML page of a report, which loads nothing but the films beside it.

Its Jinja2 template is `page.html`, its style `page.css` and its script `page.js`. The page is complete without the
script, which sorts and filters the tables. At its top stand what was run, the ranking, and the section that leads: the
film of a flight, or the rivers where there is none.
"""

import base64
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from thalweg.bench.report.html.pictures import for_the_page
from thalweg.bench.report.ranking import ranking
from thalweg.bench.report.sections import FigureSection, FilmSection, Section, TableSection
from thalweg.bench.report.table import Table, is_published, numeric_columns
from thalweg.bench.results.results import Results
from thalweg.bench.suite.record import arms_of, rules_in_words, task_of, training_in_words, training_steps
from thalweg.env.tasks import PAPER_TASK
from thalweg.train.observations import FRAMES, PRIVILEGED

HERE = Path(__file__).parent
PAPER_STEPS = 200_000
"""Training steps of the paper's runs."""
FEW_STEPS = PAPER_STEPS // 10
"""Shorter runs show that everything runs, and not which policy is better."""
ABOUT = (
    "A UAV follows a river, close above the water. In every step, a policy chooses where it moves next from what it"
    " sees. The whole course returns 10, a part of it less."
)
PAPERS_COSTS = (
    "A flight that breaks a rule ends and costs 1 (collision, left the river, too low or high) or 0.2 (faced backwards,"
    " idle, out of steps). A good policy returns much and costs little."
)


def data_uri(content: bytes, media_type: str) -> str:
    """Return the content as a `data:` URI."""
    return f"data:{media_type};base64,{base64.b64encode(content).decode()}"


TEMPLATES = Environment(
    loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
)
STYLE, SCRIPT = (Markup((HERE / name).read_text(encoding="utf-8")) for name in ("page.css", "page.js"))


def page(
    results: Results,
    sections: Sequence[Section],
    tables: Mapping[str, Table],
    files: Mapping[str, bytes],
    problems: Sequence[str],
    *,
    inline: bool = False,
) -> str:
    """Return the page of some results: its `sections` with their `tables`, the `files` beside it by name, and the
    `problems` as text.

    Films and their posters are links to the `files`, or parts of the page with `inline`, which then is one file.
    """
    suite = results.suite
    contents = [
        content for section in sections for content in _contents(section, results, tables, files, inline=inline)
    ]
    lead = next((content for content in contents if content["leads"] and (content["films"] or content["image"])), None)
    return TEMPLATES.get_template("page.html").render(
        title=f"Thalweg benchmark: {suite.get('name', 'unknown')}",
        style=STYLE,
        script=SCRIPT,
        about=_about(results),
        introduction=_introduction(results),
        problems=problems,
        ranking=ranking(results),
        lead=lead,
        levels=json.dumps(results.levels),
        sections=[content for content in contents if content is not lead],
        suite=json.dumps(suite, indent=2),
        files=list(dict.fromkeys(name.partition("/")[0] for name in files)),
    )


def _about(results: Results) -> str:
    """Return what policies do, and what returns and costs are."""
    task = task_of(results.suite)
    return f"{ABOUT} {PAPERS_COSTS if task == PAPER_TASK else f'Costs are those of the task {task}.'}"


def _introduction(results: Results) -> str:
    """Return the introductory sentences: what was trained and evaluated."""
    arms = arms_of(results.suite)
    trained = [row for row in results.runs if row.kind == "train"]
    sentences = [f"{len(results.episodes):,} evaluated episodes on {', '.join(results.levels)}."]
    if trained and arms:
        seeds = sorted({len(arm["seeds"]) for arm in arms})
        sentences.append(
            f"{len(trained)} training runs of {training_in_words(results.suite)} ({' or '.join(map(str, seeds))}"
            f" seed{'s' * (seeds[-1] > 1)})."
        )
        if (most := max(map(training_steps, arms))) < FEW_STEPS:
            sentences.append(
                f"This is far fewer than the paper's {PAPER_STEPS:,} steps: it shows that everything runs, not which"
                " policy is better."
            )
        elif most < PAPER_STEPS:
            sentences.append(f"The paper's runs have {PAPER_STEPS:,} steps.")
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
    section: Section, results: Results, tables: Mapping[str, Table], files: Mapping[str, bytes], *, inline: bool
) -> Iterator[dict[str, Any]]:
    """What the template shows of a section; nothing for one that is empty and has no fallback."""
    content: dict[str, Any] = {}
    if isinstance(section, TableSection):
        content = _table(tables[section.name])
    elif isinstance(section, FigureSection):
        content = _figure(section, results, files)
    elif films := _films(section, results, inline=inline):
        content = {"films": films}
    if content or section.fallback:
        anchor = re.sub(r"\W+", "-", getattr(section, "name", section.title.lower()))
        leads = not isinstance(section, TableSection) and section.leads
        explain = section.explain if isinstance(section, FigureSection) else None
        note = " ".join(filter(None, (section.note, explain(results) if explain else "")))
        heading = {"title": section.title, "note": note, "fallback": section.fallback, "anchor": anchor}
        yield dict.fromkeys(("columns", "image", "films")) | heading | {"leads": leads} | content


def _table(table: Table) -> dict[str, Any]:
    """Return columns and rows of a table; a column with whether it is numeric, a row with whether it is published."""
    if table.text.empty:
        return {}
    rows = table.text.itertuples(index=False, name=None)
    return {
        "columns": list(zip(table.text.columns, numeric_columns(table.text), strict=True)),
        "rows": [(row, is_published(row[0])) for row in rows],
    }


def _figure(section: FigureSection, results: Results, files: Mapping[str, bytes]) -> dict[str, Any]:
    """Return the picture of a section, small enough for the page, with its size and its description."""
    if (drawn := files.get(f"{section.name}.png")) is None:
        return {}
    small = for_the_page(drawn, photographic=section.photographic)
    return {
        "image": data_uri(small.content, small.media_type),
        "size": small.size_px,
        "description": section.description(results),
    }


def _films(section: FilmSection, results: Results, *, inline: bool) -> list[dict[str, Any]]:
    """Return the films of a section: source, poster, label and caption of each."""
    films = []
    for name, film in results.films.items():
        if section.includes(name) and film.path is not None:
            policy, _, kind = name.rpartition("/")[2].rpartition("-")
            label = "Film of a flight" + (f": {policy}, {kind}" if policy else "")
            sources = {
                "source": _source(film.path, name, "video/mp4", inline=inline),
                "poster": film.poster and _source(film.poster, name, "image/jpeg", inline=inline),
            }
            films.append(sources | {"label": label, "caption": film.words})
    return films


def _source(path: Path, name: str, media_type: str, *, inline: bool) -> str:
    """Return where the page finds a file of a film: beside it, under the film's name, or within it."""
    return data_uri(path.read_bytes(), media_type) if inline else quote(f"{name}{path.suffix}")
