"""The pages of the docs can be found, what they link to is there, and what they say to type can be typed."""

import importlib.util
import math
import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import pytest
from PIL import Image

from thalweg.algos.onpolicy.config import OnPolicyConfig
from thalweg.algos.presets import PAPER
from thalweg.algos.registry import ALGORITHMS
from thalweg.cli.encoder import ENCODER_COMMANDS
from thalweg.cli.main import COMMANDS, _parse
from thalweg.env.spaces import part_spaces
from thalweg.env.task.priced.eye import features_of
from thalweg.env.tasks import TASKS
from thalweg.render import Camera
from thalweg.render.records.classes import CLASSES
from thalweg.render.records.randomisation import Randomisation
from thalweg.world.real.file_river import plan_file

ROOT = Path(__file__).resolve().parent.parent
INDEX = ROOT / "docs" / "README.md"


def pages(root: Path = ROOT) -> list[Path]:
    """Every Markdown page of the project, from the folders that hold some: no other tool is asked."""
    found = [*root.glob("*.md"), *(root / "docs").rglob("*.md"), *(root / "benchmarks").rglob("*.md")]
    return sorted(page for page in found if root / "docs" / "site" not in page.parents)  # those are Sphinx's


def links(page: Path) -> list[str]:
    """Targets within the project that the page links to or shows."""
    targets = re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text())
    return [target for target in targets if "://" not in target and not target.startswith("mailto:")]


def unlisted(index: Path) -> list[str]:
    """Pages in the index's folder, or in folders of it, that the index does not link to."""
    linked = {(index.parent / link).resolve() for link in links(index)}
    found = [page for page in index.parent.rglob("*.md") if page != index and index.parent / "site" not in page.parents]
    return sorted(page.relative_to(index.parent).as_posix() for page in found if page.resolve() not in linked)


def commands(text: str) -> list[str]:
    """Command lines of Thalweg that a page shows to be typed in blocks of code."""
    text = re.sub(r"\\\n\s*", "", text)  # a line that goes on
    blocks = re.findall(r"^```(?:sh)?\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE)
    indented = re.findall(r"^ {4}(thalweg .*)$", text, flags=re.MULTILINE)
    lines = [line for block in blocks for line in block.splitlines()] + indented
    return [line for line in lines if line.startswith("thalweg ")]


def python_of(text: str) -> list[str]:
    """Blocks of Python that a page shows."""
    return re.findall(r"^```python\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE)


SMALLER = {
    "docs/encoder.md": {"collect_frames(2200": "collect_frames(24", "held_out=200": "held_out=4, epochs=1"},
}
"""What a test runs instead of numbers that take minutes."""
ELSEWHERE = ("README.md", "docs/training.md", "docs/other-libraries.md")
"""Pages whose Python `test_examples.py` runs, or the tests in `interop/`, where other libraries are."""
WITH_PYTHON = [
    page for page in pages() if python_of(page.read_text()) and page.relative_to(ROOT).as_posix() not in ELSEWHERE
]
ALONE = """
import sys
from pathlib import Path

for number, block in enumerate(Path("blocks").read_text().split("\\f"), start=1):
    print("block", number, flush=True)
    exec(compile(block, f"block {number}", "exec"), {"__name__": "__main__"})
"""


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_PYTHON, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_each_block_of_python_of_a_page_runs_by_itself(page: Path, tmp_path: Path):
    name, text = page.relative_to(ROOT).as_posix(), page.read_text()
    for shown, run in SMALLER.get(name, {}).items():
        assert shown in text
        text = text.replace(shown, run)
    (tmp_path / "thalweg").symlink_to(ROOT / "thalweg")  # for files that blocks name; imported it is from its own place
    (tmp_path / "blocks").write_text("\f".join(blocks := python_of(text)))
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-P", "-c", ALONE], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"block {len(blocks)}\n" in done.stdout


def test_every_docs_folder_has_pages():
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
        known = ENCODER_COMMANDS | {"": COMMANDS[arguments[0]]}
        assert type(_parse(arguments)) is known[arguments[1] if arguments[0] == "encoder" else ""], line


def test_every_command_of_the_page_of_your_river_takes_its_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "your-river.md").read_text()
    exec(python_of(page)[0].split("world = ")[0], {})
    parsed = [_parse(shlex.split(line, comments=True)[1:]) for line in commands(page) if " isar.geojson" in line]
    rivers = {tuple(command.river.words()): command.river.reach("--level", None) for command in parsed}  # pyright: ignore
    lengths = [plan_file(each.path, each).river.length_m for each in rivers.values()]
    assert len(parsed) == 7 and lengths == pytest.approx([1368, 300], abs=1)


def test_the_readme_shows_every_command_and_how_to_reach_it():
    *before, last = re.findall(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(), flags=re.DOTALL)
    assert any(block.startswith("source .venv/bin/activate") for block in before)
    assert {line.split()[1] for line in last.splitlines()} == set(COMMANDS)


def test_the_page_of_the_benchmark_names_every_suite():
    from thalweg.bench.suite.builtin import SUITES

    text = (ROOT / "docs" / "bench.md").read_text()
    assert re.findall(r"^\| `([\w-]+)` \| ", text, flags=re.MULTILINE)[: len(SUITES)] == list(SUITES)


def script(name: str) -> Any:
    """A script of the docs as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_look_of_the_followed_video_is_outside_the_ranges_of_training_in_each_number():
    film = script("follow_film")
    film.check_outside(film.LOOK)
    with pytest.raises(ValueError, match=r"haze = 6\.0 is within 0\.3 to 6\.0"):
        film.check_outside(replace(film.LOOK, haze=6.0))
    assert film.SUN_DEG[1] < Randomisation().sun_elevation_deg[0]
    trained = Camera()
    for name in ("fov_deg", "pitch_deg"):
        assert getattr(film.CAMERA, name) > getattr(trained, name) + getattr(Randomisation(), name)[1]


def test_pictures_in_a_row_keep_their_scale_and_stand_on_one_line():
    pictures = script("pictures")
    tall, wide = Image.new("RGB", (50, 100), "red"), Image.new("RGB", (150, 80), "green")
    row = pictures.row([tall, wide], 200 + pictures.GAP)
    assert row.size == (200 + pictures.GAP, 100)
    for y, right in ((0, (255, 255, 255)), (20, (0, 128, 0)), (99, (0, 128, 0))):
        colours = [row.getpixel((x, y)) for x in range(row.width)]
        assert colours == [(255, 0, 0)] * 50 + [(255, 255, 255)] * pictures.GAP + [right] * 150


WORDS = {"yes": True, "true": True, "no": False, "false": False, "none": math.inf, "√0.075": 0.075**0.5}


def said(cell: str) -> list[Any]:
    """Values of a table's cell, in their order: `256, 256` or `0, 0.1, false`."""
    values: list[Any] = []
    for word in cell.split(", "):
        number = re.fullmatch(r"-?\d{1,3}(?:,\d{3})+|-?[\d.]+(?:e-?\d+)?", word)
        values.append(WORDS[word] if word in WORDS else float(word.replace(",", "")) if number else word)
    return values


def table_values(page: Path, column: str) -> Iterator[tuple[str, Any]]:
    """Settings and their values in the tables of a page that have such a column."""
    at = None
    for line in page.read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split(" | ")] if line.startswith("|") else []
        if not cells:
            at = None
        elif cells[0].strip() == "setting":
            at = cells.index(column) if column in cells else None
        elif at is not None and (names := re.findall(r"`(\w+)`", cells[0])):
            values = said(cells[at])
            if len(names) == 1 and len(values) > 1:
                values = [tuple(values)]
            each = values * len(names) if len(values) == 1 else values  # one value may stand for several settings
            yield from zip(names, each, strict=True)


def table_settings() -> Iterator[tuple[str, str, str, Any]]:
    """Algorithm, column, setting and value of every table of settings."""
    for name in ALGORITHMS:
        page = ROOT / "docs" / "algorithms" / f"{name.lower()}.md"
        for column in ("here", "`paper`"):
            for setting, value in table_values(page, column):
                yield name, column.strip("`"), setting, value


@pytest.mark.parametrize("column", ["here", "paper"])
def test_settings_of_the_pages_are_those_of_the_code(column: str):
    """`here` is the default; what is said in words has no value to compare."""
    preset = {"here": "default", "paper": "paper"}[column]
    wrong, compared = [], 0
    for name, found, setting, value in table_settings():
        if found != column:
            continue
        real = getattr(ALGORITHMS[name].configure(None, preset), setting)
        if isinstance(value, str) and not isinstance(real, str):
            continue
        compared += 1
        if value != real and value != pytest.approx(real):
            wrong.append(f"{name}: {setting} is {real}, the page says {value}")
    assert not wrong and compared > 20


def shown_space(space: gymnasium.spaces.Box) -> str:
    """The space of a part of an observation as the page of environments writes it; bounds of numbers are left out."""
    size = ["H", "W", str(space.shape[-1])] if len(space.shape) == 3 else [str(space.shape[0])]
    low, high = (f"{value:g}" for value in (space.low.min(), space.high.max()))
    return f"{space.dtype} [{', '.join(size)}]" + (f", {low}..{high}" if len(size) > 1 else "")


def test_contributors_are_told_what_the_mark_of_slow_tests_means():
    marks = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pytest"]["ini_options"]["markers"]
    (slow,) = (mark.removeprefix("slow: takes ").split(";")[0] for mark in marks if mark.startswith("slow:"))
    assert f"Mark what takes {slow} as `slow`" in (ROOT / "CONTRIBUTING.md").read_text()


def test_the_page_of_environments_states_the_space_of_each_part():
    page = (ROOT / "docs" / "environment.md").read_text()
    table = page.split("| part | space | what it is |\n|---|---|---|\n")[1].split("\n\n")[0]
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table.splitlines()]
    spaces = part_spaces(8, 8)
    assert [row[:2] for row in rows] == [[f"`{name}`", shown_space(space)] for name, space in spaces.items()]
    assert rows[list(spaces).index("class")][2].endswith(f": {', '.join(CLASSES)}")
    numbers = spaces["privileged"].shape[0]
    assert f"| `privileged` | float32 [{numbers}], what" in page and f"`privileged` is {numbers} numbers" in page
    most, boat = max(len(features_of(task)) for task in TASKS), len(features_of("River", "asv"))
    assert f"up to {most} numbers in [tasks](tasks.md), and {boat} for [boats](boats.md)" in page


@pytest.mark.parametrize("name", [name for name in PAPER if not issubclass(ALGORITHMS[name].config, OnPolicyConfig)])
def test_the_page_names_everything_that_the_preset_sets_otherwise(name: str):
    """Its section on OmniSafe, or that of the page with which this section begins."""
    pages = {"DDPGLag": (), "CCEPETS": ()}.get(name, ("ddpglag",) if name.endswith("Lag") else ("ccepets",))
    whole = [(ROOT / "docs" / "algorithms" / f"{page}.md").read_text() for page in (name.lower(), *pages)]
    texts = [text.split("## What differs from OmniSafe")[1].split("\n## ")[0] for text in whole]
    entry = ALGORITHMS[name]
    default, paper = entry.configure(), entry.configure(None, "paper")
    differing = [key for key in PAPER[name] if getattr(default, key) != getattr(paper, key)]
    assert [key for key in differing if not any(f"`{key}`" in text for text in texts)] == []
