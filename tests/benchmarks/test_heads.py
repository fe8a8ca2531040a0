"""The comparison of heads: what a row is of, and the table."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
MARKS = "before\n<!-- heads -->\nold\n<!-- /heads -->\nafter\n"


@pytest.fixture
def heads(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    for name in ("any_river", "ladder_arms", "river_flights", "joint_head", "heads"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return importlib.import_module("heads")


def test_heads_are_trained_alike_and_a_row_names_its_versions(heads: ModuleType):
    joint, branches = (heads.Trial(head, 1, 2048, 10) for head in (heads.JOINT, heads.BRANCHES))
    assert joint.key[1:] == branches.key[1:] and joint.folder != branches.folder
    assert dict(zip(heads.KEY, joint.key, strict=True))["imitation"] == str(heads.versions.IMITATION)


def test_the_page_has_a_line_for_each_head(heads: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    rows = []
    for seed, cost in enumerate((0.2, 0.3, 0.4)):
        values = {"return_Medium": "9.000", "states": "16384", "regret": f"{cost:.4f}", "fatal": "0.0004"}
        values["violations_Hard"] = f"{cost:.4f}"
        trial = heads.Trial(heads.JOINT, seed, heads.STEPS, heads.EPISODES)
        filled = dict.fromkeys((*heads.RETURNS, *heads.COMMON), "0.5000") | values
        rows.append(dict(zip(heads.KEY, trial.key, strict=True)) | filled)
    page, table = tmp_path / "page.md", tmp_path / "heads.csv"
    page.write_text(MARKS)
    for row in rows:
        heads.append(table, heads.COLUMNS, row)
    monkeypatch.setattr(heads, "PAGE", page)
    heads.main(["--write", "--out", str(table)])
    written = " ".join(page.read_text().split())
    # The half width of three seeds 0.1 apart is 4.3027 x 0.1 / sqrt(3).
    assert "| over joint moves | 3 | 9.00 [9.00, 9.00] |" in written and "| 0.3000 [0.0516, 0.5484] |" in written
    assert "| 30.0 % [5.2, 54.8] |" in written and "| 0.04 % [0.04, 0.04] |" in written
    assert "| return, Medium |" in written and "| cross-entropy |" in written
    assert "one for each branch" not in written and written.startswith("before") and written.endswith("after")
    outdated = [row | {"imitation": "0"} for row in rows]
    table.unlink()
    for row in outdated:
        heads.append(table, heads.COLUMNS, row)
    heads.main(["--write", "--out", str(table)])
    assert "Nothing was measured with today's versions." in page.read_text()
