"""Tests of OmniSafe's virtual environment: the repair of Safety-Gymnasium, on a small copy."""

import sys
from pathlib import Path

import pytest

from benchmarks.omnisafe import environment
from benchmarks.peer_venv import SetupError, create_venv

SOURCE = '''from dataclasses import dataclass
import numpy as np
COLOR, GROUP = {"goal": np.array([0, 1, 0, 0.25])}, {"goal": np.array([1])}

@dataclass
class Goal:
    """color: np.array = COLOR['goal']"""

    size: float = 0.3
    color: np.array = COLOR['goal']
    group: np.array = GROUP['goal']
    alpha: float = COLOR['goal'][-1]
'''


def test_arrays_become_factories_and_nothing_else_changes():
    mended, count = environment.with_factories(SOURCE)
    assert count == 2
    changed = [(old, new) for old, new in zip(SOURCE.splitlines(), mended.splitlines(), strict=True) if old != new]
    assert changed == [
        ("from dataclasses import dataclass", "from dataclasses import dataclass, field"),
        ("    color: np.array = COLOR['goal']", "    color: np.array = field(default_factory=lambda: COLOR['goal'])"),
        ("    group: np.array = GROUP['goal']", "    group: np.array = field(default_factory=lambda: GROUP['goal'])"),
    ]


def test_repaired_source_runs_under_python_3_11():
    with pytest.raises(ValueError, match="mutable default"):
        exec(SOURCE, {"__name__": "goal"})
    mended: dict = {"__name__": "goal"}
    exec(environment.with_factories(SOURCE)[0], mended)
    goal = mended["Goal"]()
    assert goal.color.tolist() == [0, 1, 0, 0.25] and goal.group.tolist() == [1] and goal.alpha == 0.25


def test_an_existing_import_of_field_stays_and_a_second_repair_changes_nothing():
    there = SOURCE.replace("import dataclass\n", "import dataclass, field\n")
    mended, count = environment.with_factories(there)
    assert count == 2 and mended.count("field\n") == 1
    assert environment.with_factories(mended) == (mended, 0)


def fake_environment(folder: Path, files: int) -> Path:
    """Return a Python that always succeeds, with a Safety-Gymnasium of `files` files to repair."""
    package = folder / "lib" / "python3.11" / "site-packages" / "safety_gymnasium" / "assets"
    package.mkdir(parents=True)
    for number in range(files):
        (package / f"goal{number}.py").write_text(SOURCE)
    python = folder / "bin" / "python"
    python.parent.mkdir()
    python.symlink_to("/bin/true")
    return python


def test_all_24_arrays_are_replaced(tmp_path: Path):
    python = fake_environment(tmp_path, 12)
    environment.finish(python)
    found = sorted(tmp_path.rglob("*.py"))
    assert len(found) == 12
    assert all(file.read_text() == environment.with_factories(SOURCE)[0] for file in found)


def test_another_number_of_arrays_is_an_error(tmp_path: Path):
    with pytest.raises(SetupError, match="expected 24 arrays as defaults in Safety-Gymnasium, found 22"):
        environment.finish(fake_environment(tmp_path, 11))


@pytest.mark.slow
def test_an_omnisafe_that_cannot_be_imported_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(environment, "DEFAULTS", 0)
    recipe = environment.Recipe("OmniSafe", ((3, 11),), (), environment.finish)
    with pytest.raises(SetupError, match="No module named 'omnisafe'"):
        create_venv(recipe, sys.executable, tmp_path / "venv")
    assert list(tmp_path.iterdir()) == []


def test_the_key_changes_with_a_pin_and_with_the_repair():
    recipe = environment.RECIPE
    installs = (("numpy==1.26.3", *recipe.installs[0][1:]), *recipe.installs[1:])
    keys = {
        recipe.key,
        environment.Recipe(recipe.peer, recipe.pythons, installs, recipe.finish, finishing=recipe.finishing).key,
        environment.Recipe(recipe.peer, recipe.pythons, recipe.installs, recipe.finish, finishing="other").key,
    }
    assert len(keys) == 3
    assert all("==" in word or word == "--no-deps" for install in recipe.installs for word in install)
