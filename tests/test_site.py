"""Tests of what the documentation's site is made from: staged pages, the notebook, and tables that sort."""

import base64
import importlib
import json
import re
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from tests.browser import Browser, missing_for_browser
from thalweg.cli.encoder import ENCODER_COMMANDS
from thalweg.cli.main import COMMANDS

ROOT = Path(__file__).resolve().parent.parent
SITE = ROOT / "docs" / "site"
sys.path.append(str(SITE))
commands_page: Any = importlib.import_module("commands_page")
stage: Any = importlib.import_module("stage")
notebook_page: Any = importlib.import_module("notebook_page")
run_notebook: Any = importlib.import_module("run_notebook")
NOTEBOOK = ROOT / "examples" / "first_flight.ipynb"


@pytest.fixture
def project(tmp_path: Path) -> Path:
    (tmp_path / "docs").mkdir()
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "rules.py").write_text('"""The rules."""\n')
    (tmp_path / "docs" / "other.md").write_text("# Other\n")
    return tmp_path


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("[r](../code/rules.py)", "[r](../source/code/rules.py.md)"),
        ("[c](../code)", "[c](../source/code.md)"),
        ("[o](other.md#part) and [here](#part)", "[o](other.md#part) and [here](#part)"),
        ("```\n[r](../code/rules.py)\n```", "```\n[r](../code/rules.py)\n```"),
        ("[w](https://example.org/a)", "[w](https://example.org/a)"),
    ],
)
def test_links_to_code_lead_to_pages_of_it(project: Path, written: str, expected: str):
    assert stage.rewritten(written, "docs/page.md", project)[0] == expected


@pytest.mark.parametrize("target", ["missing.md", "../../outside.md", "https://nowhere", "mailto:me", "ftp://a.b"])
def test_a_link_that_leads_nowhere_is_an_error_that_names_page_and_target(project: Path, target: str):
    with pytest.raises(stage.LinkError) as error:
        stage.rewritten(f"[x]({target})", "docs/page.md", project)
    assert str(error.value).startswith(f"docs/page.md: {target!r}")


def test_a_part_of_another_file_stands_where_a_comment_names_it(project: Path):
    (project / "README.md").write_text("before\n<!-- peers -->\n| a |\n<!-- /peers -->\nafter")
    assert stage.with_parts("top\n<!-- part of README.md: peers -->\nend", project) == "top\n| a |\nend"
    with pytest.raises(stage.LinkError, match=r"README\.md has no part 'other'"):
        stage.with_parts("<!-- part of README.md: other -->", project)


def test_a_folder_is_listed_with_the_first_lines_of_its_modules(project: Path):
    page = stage.source_page(project / "code", project)
    assert page.endswith("# code/\n\n- [rules.py](code/rules.py.md): The rules.\n")


def test_every_page_of_the_docs_is_in_one_table_of_contents(tmp_path: Path):
    stage.Stage(tmp_path).gather()
    staged = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.md")}
    docs = {path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md") if SITE not in path.parents}
    assert docs | {"examples/first_flight.md", "source/thalweg/env/config.py.md"} <= staged
    listed = stage.listed(path.read_text() for path in (SITE / "pages").rglob("*.md"))
    guides = (tmp_path / "guides.md").read_text()
    assert [page for page in docs if (page.removesuffix(".md") not in listed) != (f"\n/{page[:-3]}\n" in guides)] == []


def test_a_folder_that_was_not_staged_is_left_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "thesis.tex").write_text("mine")
    monkeypatch.setattr(sys, "argv", ["stage.py", str(tmp_path)])
    with pytest.raises(SystemExit, match=r"is not empty, and bears no mark of this script, which removes"):
        stage.main()
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_what_is_no_page_any_more_is_removed_from_a_staged_folder(tmp_path: Path):
    stage.Stage(tmp_path / "site").claim()
    (tmp_path / "site" / "old.md").write_text("an old page")
    stage.Stage(tmp_path / "site").gather()
    assert not (tmp_path / "site" / "old.md").exists() and (tmp_path / "site" / "guides.md").is_file()


def test_every_module_that_a_page_imports_from_is_in_the_reference():
    directive = re.compile(r"^\.\. automodule:: (\S+)$", re.MULTILINE)
    named = {
        name for path in (SITE / "pages" / "reference").glob("*.md") for name in directive.findall(path.read_text())
    }
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    pages += [path for ending in ("py", "ipynb") for path in (ROOT / "examples").rglob(f"*.{ending}")]
    imported = re.compile(r'^[ "]*from (thalweg[\w.]*) import ', re.MULTILINE)
    assert {name for path in pages for name in imported.findall(path.read_text())} - named == set()


def test_every_command_is_on_the_page_of_commands_with_all_its_options():
    sections = commands_page.commands_page().split("\n## thalweg ")[1:]
    kinds = {**COMMANDS, **{f"encoder {name}": kind for name, kind in ENCODER_COMMANDS.items()}}
    del kinds["encoder"]
    assert [section.split("\n")[0] for section in sections] == commands_page.commands()
    assert sorted(commands_page.commands()) == sorted(kinds)
    for section in sections:
        kind = kinds[section.split("\n")[0]]
        flags = {f"--{each.name.replace('_', '-')}" for each in fields(kind) if isinstance(each.default, int | Path)}
        shown = re.findall(r"^- `(.+?)`: \S.{8}", section, re.MULTILINE)
        assert flags - {word for each in shown for word in re.split(r"[ ,]+", each)} == set()
        assert len(shown) == sum(line.startswith("- ") for line in section.split("\n"))
        assert " ".join(str(kind.__doc__).split())[:60] in section


def test_an_option_of_the_page_of_commands_has_its_help_and_its_default():
    lines = commands_page.section("evaluate").split("\n")
    assert lines[4] == "    thalweg evaluate [-h] [OPTIONS] STR"
    assert "- `--starts-seed INT`: Seed of the list of starts. (default: 0)" in lines
    assert "- `--world-seed INT`: Seed of the plants and hills; only with `--river`." in lines


def test_a_notebook_becomes_a_page_with_its_outputs(tmp_path: Path):
    outputs = [
        {"output_type": "stream", "name": "stdout", "text": ["2\n"]},
        {"output_type": "display_data", "metadata": {}, "data": {"image/png": base64.b64encode(b"png").decode()}},
    ]
    cells = [
        {"cell_type": "markdown", "source": ["# A\n", "b"]},
        {"cell_type": "code", "source": "print(2)", "outputs": outputs},
    ]
    (tmp_path / "n.ipynb").write_text(json.dumps({"cells": cells}))
    text, pictures = notebook_page.notebook_to_markdown(tmp_path / "n.ipynb")
    assert text.split("\n\n")[:3] == ["# A\nb", "```python\nprint(2)\n```", "```text\n2\n```"]
    assert pictures == {"n_0.png": b"png"} and "](n_0.png)" in text


def printed(notebook: dict[str, Any]) -> list[str]:
    """Return what the cells of a notebook print."""
    outputs = [output for cell in notebook["cells"] for output in cell.get("outputs", [])]
    return [notebook_page.joined(output["text"]) for output in outputs if output["output_type"] == "stream"]


@pytest.mark.slow
def test_the_notebook_runs_and_prints_what_is_stored_in_it():
    stored = printed(json.loads(NOTEBOOK.read_text(encoding="utf-8")))
    assert len(stored) == 5 and printed(run_notebook.run_notebook(NOTEBOOK)) == stored


def test_an_error_in_a_cell_is_not_swallowed():
    with pytest.raises(ZeroDivisionError):
        run_notebook.run_cell("1 / 0", {}, "cell 1")


ROWS = [("PPO", "9.08 [7, 10]"), ("SACLag", "missing"), ("CPO", "10.00"), ("CUP", "0.5")]


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.skipif(bool(missing_for_browser()), reason=missing_for_browser())
def test_the_leaderboard_sorts_by_a_column(tmp_path: Path):
    body = "".join(f"<tr><td>{name}</td><td>{value}</td></tr>" for name, value in ROWS)
    table = f"<table><thead><tr><th>policy</th><th>return</th></tr></thead><tbody>{body}</tbody></table>"
    script = (SITE / "static" / "sortable.js").read_text()
    (tmp_path / "leaderboard.html").write_text(f"<article>{table}</article><script>{script}</script>")
    browser = Browser()
    try:
        driver: Any = browser.driver
        driver.get((tmp_path / "leaderboard.html").as_uri())
        seen = []
        for column in (1, 1, 0):
            driver.find_elements("css selector", "th button")[column].click()
            seen.append([row.text for row in driver.find_elements("css selector", "td:first-child")])
    finally:
        browser.close()
    assert seen == [
        ["CPO", "PPO", "CUP", "SACLag"],
        ["CUP", "PPO", "CPO", "SACLag"],
        ["CPO", "CUP", "PPO", "SACLag"],
    ]
