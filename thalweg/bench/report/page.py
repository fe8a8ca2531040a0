"""How do tables, pictures and the film become one HTML page that loads nothing from elsewhere?

The page is whole without its script, which sorts and filters its tables. Its style and script lie in `page.css` and
`page.js`, and are put into `page.html`.
"""

import base64
import html
import json
from pathlib import Path
from string import Template

from thalweg.bench.report.sections import PARTS, Films, Picture, Table
from thalweg.bench.report.tables import Grid, is_published, number_columns
from thalweg.bench.results.results import Results
from thalweg.bench.suite.suites import arms_of


def _text(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


TEMPLATE, STYLE, SCRIPT = Template(_text("page.html")), _text("page.css"), _text("page.js")


def page(results: Results, grids: dict[str, Grid], files: dict[str, bytes], problems: list[str]) -> str:
    """The page of some results: `grids` are its tables and `files` what lies beside it, by name."""
    suite = results.suite
    return TEMPLATE.substitute(
        title=html.escape(f"Thalweg: suite {suite.get('name', 'unknown')}"),
        style=STYLE,
        script=SCRIPT,
        intro=html.escape(_intro(results)),
        problems=_problems(problems),
        levels=html.escape(json.dumps(results.levels)),
        sections="\n".join(_section(part, results, grids, files) for part in PARTS),
        record=html.escape(json.dumps(suite, indent=2)),
        files=html.escape(f"Beside this page: {', '.join(files)}."),
    )


def _intro(results: Results) -> str:
    suite = results.suite
    trained = [row for row in results.runs if row.kind == "train"]
    parts = [f"{len(results.episodes)} evaluated episodes on {', '.join(results.levels)}."]
    if trained and arms_of(suite):
        steps = sorted({arm["steps"] for arm in arms_of(suite)})
        seeds = max(len(arm["seeds"]) for arm in arms_of(suite))
        levels = dict.fromkeys(arm.get("level") or suite["train_level"] for arm in arms_of(suite))
        parts.append(
            f"{len(trained)} training runs of {' or '.join(f'{count:,}' for count in steps)} steps on"
            f" {' or '.join(levels)} ({seeds} seed{'s' * (seeds > 1)})."
        )
        if steps[-1] < 200_000:
            parts.append(
                "This is far shorter than the paper's 200,000 steps: it shows that everything runs, not who is better."
            )
    return " ".join(parts)


def _problems(lines: list[str]) -> str:
    if not lines:
        return ""
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    return f"<section class='problems'><h2>Failed, missing or not used</h2><ul>{items}</ul></section>"


def _section(part: Table | Picture | Films, results: Results, grids: dict[str, Grid], files: dict[str, bytes]) -> str:
    """A part with its heading and its note, or the words that stand in its place."""
    if isinstance(part, Table):
        body = html_table(*grids[part.name], part.title) if grids[part.name][1] else ""
    elif isinstance(part, Picture):
        body = _picture(files.get(f"{part.name}.png"), part.words(results))
    else:
        films = [(name, film) for name, film in results.films.items() if part.names(name)]
        body = _films([_film(name, film.path, film.words) for name, film in films if film.path is not None])
    if not body and not part.otherwise:
        return ""
    body = body or f"<p>{html.escape(part.otherwise)}</p>"
    note = f"\n<p class='note'>{html.escape(part.note)}</p>" if part.note else ""
    return f"<section>\n<h2>{html.escape(part.title)}</h2>\n{body}{note}\n</section>"


def html_table(header: list[str], rows: list[list[str]], title: str = "") -> str:
    """A table in HTML that scrolls by itself; published rows are set apart, columns of words stand to the left."""
    kinds = ["" if number else " class='word'" for number in number_columns((header, rows))]
    head = "".join(f"<th scope='col'{kind}>{html.escape(cell)}</th>" for cell, kind in zip(header, kinds, strict=True))
    body = []
    for row in rows:
        first, *rest = (html.escape(cell) for cell in row)
        cells = "".join(f"<td{kind}>{cell}</td>" for cell, kind in zip(rest, kinds[1:], strict=True))
        apart = " class='elsewhere'" if is_published(row) else ""
        body.append(f"<tr{apart}><th scope='row'>{first}</th>{cells}</tr>")
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table>"
    return f"<div class='wide' role='region' aria-label='{html.escape(title)}' tabindex='0'>{table}</div>"


def _picture(content: bytes | None, words: str) -> str:
    if content is None:
        return ""
    data = base64.b64encode(content).decode()
    image = f"<img src='data:image/png;base64,{data}' alt='{html.escape(words)}'>"
    return f"<figure><div class='wide picture'>{image}</div></figure>"


def _films(figures: list[str]) -> str:
    """Films beside one another, as many as fit; one alone has all the width."""
    return figures[0] if len(figures) == 1 else f"<div class='films'>{''.join(figures)}</div>" if figures else ""


def _film(name: str, path: Path, caption: str) -> str:
    """A film that is played when it is asked for, and under it what it shows."""
    data = base64.b64encode(path.read_bytes()).decode()
    policy, _, kind = name.rpartition("/")[2].rpartition("-")
    words = "Film of a flight" + (f": {policy}, {kind}" if policy else "")
    return (
        f"<figure><video controls muted loop playsinline src='data:video/mp4;base64,{data}'"
        f" aria-label='{html.escape(words)}'></video><figcaption>{html.escape(caption)}</figcaption></figure>"
    )
