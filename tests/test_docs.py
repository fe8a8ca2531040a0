"""The pages of the docs can be found, what they link to is there, and what they say to type can be typed."""

import re
import shlex
from pathlib import Path

import pytest

from thalweg.cli import COMMANDS, _parse

ROOT = Path(__file__).resolve().parent.parent
INDEX = ROOT / "docs" / "README.md"


def pages(root: Path = ROOT) -> list[Path]:
    """Every Markdown page of the project, from the folders that hold some: no other tool is asked."""
    return sorted([*root.glob("*.md"), *(root / "docs").rglob("*.md"), *(root / "benchmarks").rglob("*.md")])


def links(page: Path) -> list[str]:
    """Targets within the project that the page links to or shows."""
    targets = re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text())
    return [target for target in targets if "://" not in target and not target.startswith("mailto:")]


def unlisted(index: Path) -> list[str]:
    """Pages in the index's folder, or in folders of it, that the index does not link to."""
    linked = {(index.parent / link).resolve() for link in links(index)}
    found = [page for page in index.parent.rglob("*.md") if page != index]
    return sorted(page.relative_to(index.parent).as_posix() for page in found if page.resolve() not in linked)


def commands(text: str) -> list[str]:
    """Command lines of Thalweg that a page shows to be typed in blocks of code."""
    text = re.sub(r"\\\n\s*", "", text)  # a line that goes on
    blocks = re.findall(r"^```(?:sh)?\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE)
    indented = re.findall(r"^ {4}(thalweg .*)$", text, flags=re.MULTILINE)
    lines = [line for block in blocks for line in block.splitlines()] + indented
    return [line for line in lines if line.startswith("thalweg ")]


def test_there_are_pages_in_every_place():
    names = {page.relative_to(ROOT).as_posix() for page in pages()}
    assert {"README.md", "docs/README.md", "docs/algorithms/ppo.md", "benchmarks/README.md"} <= names


def test_every_link_within_the_project_leads_somewhere():
    broken = [f"{page.name}: {link}" for page in pages() for link in links(page) if not (page.parent / link).exists()]
    assert broken == []


def test_every_page_of_the_docs_is_linked_from_its_index():
    assert unlisted(INDEX) == []


def test_a_page_in_a_folder_of_the_docs_must_be_listed_too(tmp_path: Path):
    (tmp_path / "algorithms").mkdir()
    (tmp_path / "algorithms" / "new.md").write_text("# New")
    (tmp_path / "old.md").write_text("# Old")
    index = tmp_path / "README.md"
    index.write_text("[old](old.md)")
    assert unlisted(index) == ["algorithms/new.md"]


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_command_of_a_page_is_understood(page: Path):
    for line in commands(page.read_text()):
        arguments = shlex.split(line, comments=True)[1:]
        assert type(_parse(arguments)) is COMMANDS[arguments[0]], line


def test_the_readme_shows_every_command_and_how_to_reach_it():
    *before, last = re.findall(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(), flags=re.DOTALL)
    assert any(block.startswith("source .venv/bin/activate") for block in before)
    assert {line.split()[1] for line in last.splitlines()} == set(COMMANDS)


def test_the_page_of_the_benchmark_names_every_suite():
    from thalweg.bench.suites import SUITES

    text = (ROOT / "docs" / "bench.md").read_text()
    assert re.findall(r"^\| `(\w+)` \| ", text, flags=re.MULTILINE)[: len(SUITES)] == list(SUITES)
