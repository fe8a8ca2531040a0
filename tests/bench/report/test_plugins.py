"""Tests of report sections from outside the package: their place, their files, and what a broken one does."""

import re
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from tests.plugins import install, no_plugins  # noqa: F401  (a fixture)
from thalweg.bench.report.plugins import SectionPlugin
from thalweg.bench.report.report import write_report
from thalweg.bench.report.sections import FigureSection, FilmSection, TableSection
from thalweg.bench.report.table import table_from_cells
from thalweg.core.plugins.lookup import VARIABLE, add_files
from thalweg.core.plugins.record import PluginError, PluginWarning

pytestmark = pytest.mark.usefixtures("no_pictures", "no_plugins")
ROOT = Path(__file__).resolve().parents[3]
(SECTION,) = re.findall(
    r"```python\n(\"\"\"A section of reports.*?)```", (ROOT / "docs" / "extend.md").read_text(), flags=re.DOTALL
)


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """The section of docs/extend.md, which is used."""
    (tmp_path / "mine.py").write_text(SECTION)
    add_files([tmp_path / "mine.py"])
    return tmp_path / "mine.py"


def titles(page: Path) -> list[str]:
    return re.findall(r"<h2[^>]*>(.*?)</h2>", page.read_text())


def test_the_section_of_the_docs_stands_at_its_place_with_version_and_source(mine: Path, tiny_results: Path):
    report = write_report(tiny_results)
    shown = titles(report.page)
    assert shown.index("Longest flights") == shown.index("Return and cost") + 1
    assert re.search(r"By the plug-in longest, version 1 \(source \w{16}\)\.", report.page.read_text())
    lines = (report.folder / "plugin-longest.csv").read_text().splitlines()
    assert lines[0] == "policy,level,steps" and len(lines) > 1
    assert {path.suffix for path in report.folder.glob("plugin-longest.*")} == {".md", ".tex", ".csv"}


def test_a_section_that_is_not_there_any_more_leaves_no_files(
    mine: Path, tiny_results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    write_report(tiny_results, tmp_path / "out")
    monkeypatch.setenv(VARIABLE, "")
    report = write_report(tiny_results, tmp_path / "out")
    assert list(report.folder.glob("plugin-*")) == []
    assert "Longest flights" not in titles(report.page)


def test_a_section_that_fails_is_left_out_and_named(mine: Path, tiny_results: Path):
    before = write_report(tiny_results)
    mine.write_text(SECTION.replace("row.length", "row.size"))
    report = write_report(tiny_results)
    words = (
        "Left out: the section 'Longest flights' of a plug-in: AttributeError: 'Episode' object has no attribute 'size'"
    )
    assert [line for line in report.problems if line not in before.problems] == [words]
    assert words.replace("'", "&#39;") in report.page.read_text()
    assert "Longest flights" not in titles(report.page)
    assert not (report.folder / "plugin-longest.csv").exists()


def test_a_broken_entry_point_is_left_out_with_a_warning(
    tiny_results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    install(tmp_path / "site", {"thalweg.report_sections": {"broken": "nowhere_at_all:PLUGIN"}})
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    with pytest.warns(PluginWarning, match="a plug-in is left out: the entry point 'broken' of mine 1"):
        assert "Return and cost" in titles(write_report(tiny_results).page)


def test_an_empty_figure_of_a_plugin_shows_its_fallback(tiny_results: Path, tmp_path: Path):
    (tmp_path / "mine.py").write_text(
        "from thalweg.bench.report.plugins import SectionPlugin\n"
        "from thalweg.bench.report.sections import FigureSection\n"
        "S = SectionPlugin(FigureSection('none', 'None', lambda _: None, str, fallback='Nothing at all.'), version=1)\n"
    )
    add_files([tmp_path / "mine.py"])
    report = write_report(tiny_results)
    assert titles(report.page)[-2:] == ["None", "The record"] and "Nothing at all." in report.page.read_text()


def table(_: Any) -> Any:
    return table_from_cells(["policy"], [["hover"]])


@pytest.mark.parametrize(
    ("section", "changes", "words"),
    [
        (TableSection("details", "T", table), {}, "the report section 'details' comes with the package"),
        (
            TableSection("My", "T", table),
            {},
            "the name of the report section is 'My'; it must begin with a small letter",
        ),
        (TableSection("mine", "T", table), {"version": 0}, "the report section mine has the version 0"),
        (
            FigureSection("mine", "F", lambda _: Figure(), str),
            {"after": "tables"},
            "stands after 'tables'; there are table",
        ),
        (FilmSection("mine", bool), {}, "it must be a TableSection or a FigureSection"),
    ],
)
def test_what_a_section_lacks_is_said(section: Any, changes: dict[str, Any], words: str):
    assert SectionPlugin(TableSection("mine", "T", table), version=1, after="details").name == "mine"
    with pytest.raises(PluginError, match=re.escape(words)):
        given: dict[str, Any] = {"version": 1} | changes
        SectionPlugin(section, **given)
