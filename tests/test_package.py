"""Tests that the wheel includes all data files of the package, that docstrings are statements, and what CI tests."""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.interop.run import names

ROOT = Path(__file__).resolve().parent.parent


def test_every_file_of_the_package_goes_into_the_wheel():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    patterns = settings["tool"]["setuptools"]["package-data"]["thalweg"]
    package = ROOT / "thalweg"
    taken = {path for pattern in patterns for path in package.glob(pattern)}
    others = {path for path in package.rglob("*") if path.is_file() and path.suffix not in (".py", ".pyc")}
    assert others - taken == set()
    assert {"page.html", "page.css", "page.js"} <= {path.name for path in taken}


def test_the_picture_of_the_architecture_has_a_box_for_each_part():
    tree = ast.parse((ROOT / "docs" / "architecture_picture.py").read_text())
    records = {
        each.targets[0].id: set(ast.literal_eval(each.value))
        for each in tree.body
        if isinstance(each, ast.Assign) and isinstance(each.targets[0], ast.Name) and isinstance(each.value, ast.Dict)
    }
    parts = {path.parent.name for path in (ROOT / "thalweg").glob("*/__init__.py")}
    assert records == {"BOXES": parts, "CAPTIONS": parts, "COLOURS": parts}


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_the_set_up_says_beforehand_that_it_takes_minutes():
    recipe = subprocess.run(["make", "-n", "-B", "setup"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    before, _, after = recipe.partition("-m pip install")
    assert "takes a few minutes" in before and "is ready" in after


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_the_set_up_leaves_an_environment_of_another_tool_as_it_is(tmp_path: Path):
    shutil.copy(ROOT / "Makefile", tmp_path)
    for name in ("requirements.lock", "pyproject.toml", ".venv/mine.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    done = subprocess.run(["make", "setup", f"PYTHON={sys.executable}"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode != 0 and "There is a .venv without a working pip" in done.stderr
    assert [path.name for path in (tmp_path / ".venv").iterdir()] == ["mine.txt"]


def test_module_docstrings_are_statements():
    """Direct questions, and indirect ones such as "Who may ask the server", do not name what a file holds."""
    folders = ("thalweg", "tests", "benchmarks", "docs", "examples")
    questions = []
    for path in (path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        first = docstring.split("\n\n")[0]
        if "?" in first or re.match(r"(Who|Whom|Whose|What|Which|When|Where|How|Whether|Why)\b", first):
            questions.append(str(path.relative_to(ROOT)))
    assert sorted(questions) == []


def test_the_pages_name_the_libraries_that_ci_tests():
    (given,) = re.findall(r'^part test-interop LIBRARIES="(.*)"$', (ROOT / ".ci" / "run").read_text(), re.MULTILINE)
    assert set(given.split()) <= set(names())
    shown = {"lerobot": "LeRobot", "pufferlib": "PufferLib"}
    shown |= {"stable_baselines3": "Stable-Baselines3", "torchrl": "TorchRL"}
    *first, last = (shown[name] for name in given.split())
    for page in ("CONTRIBUTING.md", "docs/other-libraries.md"):
        words = " ".join((ROOT / page).read_text().split())
        assert re.search(rf"CI runs those of {', '.join(first)} and {last}\b", words), page
