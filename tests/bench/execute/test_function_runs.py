"""Functions in suites: flown once, never trained, and shown apart from policies that were."""

import csv
import json
import os
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.bench.small_backend import ARMS, SUITE, SmallBackend
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.runner import run_suite
from thalweg.bench.leaderboard import entries, leaderboard
from thalweg.bench.leaderboard.requirements import REQUIREMENTS
from thalweg.bench.report.report import problems
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.run_versions import read_sources, read_versions
from thalweg.bench.suite.arms import Run
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.flown import Function
from thalweg.core import versions
from thalweg.core.plugins.record import PluginWarning

pytestmark = pytest.mark.usefixtures("no_pictures")
ROOT = Path(__file__).resolve().parents[3]
AHEAD = """
def ahead(obs):
    return [1, 1, 0, 1]


ahead.version = 1
ahead.observation = "privileged"
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A file with a function."""
    (tmp_path / "mine.py").write_text(AHEAD)
    return tmp_path / "mine.py"


def suite(file: Path, **changes: object) -> Suite:
    given = {"arms": (), "test_levels": ("Easy", "Medium", "Hard"), "policies": (Function(f"{file}:ahead"),), **changes}
    return replace(SUITE, **given)


def flown(backend: SmallBackend) -> list[str]:
    assert not [call for call in backend.calls if call.startswith("train")]
    return [call.removeprefix("evaluate ") for call in backend.calls if call.startswith("evaluate ahead")]


def test_a_suite_flies_a_function_once_and_records_its_version_and_source(file: Path, tmp_path: Path):
    backend, planned = SmallBackend(), suite(file)
    assert planned.runs() == (Run("baseline", "hover", 0), Run("function", "ahead", 0))
    assert planned.observation_of(planned.runs()[1]) == "privileged"
    outcome = run_suite(planned, tmp_path / "results", backend)
    assert flown(backend) == ["ahead-0 Easy", "ahead-0 Medium", "ahead-0 Hard"]
    assert read_versions(tmp_path / "results")["ahead-0"] == {
        "world": versions.WORLD, "rules": versions.RULES, "evaluation": versions.EVALUATION,
        "privileged": versions.PRIVILEGED, "ahead": 1,
    }  # fmt: skip
    source = planned.function("ahead").policy.source
    assert read_sources(tmp_path / "results") == {"ahead-0": {"ahead": source}}
    assert (problems(outcome.results), outcome.results.policies) == ([], ["hover", "ahead"])
    recorded = json.loads((tmp_path / "results" / "suite.json").read_text())["policies"]
    assert recorded == [{"function": f"{file}:ahead", "name": "ahead", "observation": "privileged"}]


def test_the_leaderboard_lists_functions_of_a_task_apart(file: Path, tmp_path: Path):
    rules: dict[str, Any] = {"task": "Nests", "observation": "privileged"}
    planned = suite(file, arms=ARMS[:1], test_levels=("Medium",), **rules)
    run_suite(planned, tmp_path / "results", SmallBackend())
    trained, _, apart = leaderboard([tmp_path / "results"]).partition("### Nests, not trained here\n")
    assert [("PPO" in part, "ahead" in part) for part in (trained, apart)] == [(True, False), (False, True)]


def test_a_page_of_tasks_alone_has_no_requirements_of_the_papers_task(file: Path, tmp_path: Path):
    run_suite(suite(file, task="Nests", test_levels=("Medium",)), tmp_path / "results", SmallBackend())
    assert REQUIREMENTS[0] not in leaderboard([tmp_path / "results"])


def test_a_raised_version_flies_it_again_and_a_changed_source_warns(file: Path, tmp_path: Path):
    folder = tmp_path / "results"
    run_suite(suite(file), folder, SmallBackend())
    file.write_text(AHEAD + "x = 1\n")
    again = SmallBackend()
    with pytest.warns(PluginWarning, match="the source of ahead has changed since run ahead-0"):
        run_suite(suite(file), folder, again)
    assert flown(again) == []
    file.write_text(AHEAD.replace("version = 1", "version = 2"))
    run_suite(suite(file), folder, again)
    assert flown(again) == ["ahead-0 Easy", "ahead-0 Medium", "ahead-0 Hard"]
    assert read_versions(folder)["ahead-0"]["ahead"] == 2
    with pytest.raises(ResultsError, match="belongs to another suite: policies is "):
        run_suite(replace(suite(file), policies=()), folder, SmallBackend())


def test_the_report_of_a_function_needs_no_file_of_it(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = tmp_path / "results"
    run_suite(suite(file), folder, SmallBackend())
    file.unlink()
    assert (read_results(folder).outdated, problems(read_results(folder))) == ({}, [])
    monkeypatch.setattr(versions, "RULES", versions.RULES + 1)
    assert set(read_results(folder).outdated) == {f"{name} (rules {versions.RULES - 1})" for name in ("hover", "ahead")}


def test_the_leaderboard_lists_functions_apart_with_version_and_source(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("tests.bench.small_backend.SUITE", replace(SUITE, episodes=20))
    planned = suite(file, episodes=20, conditions=("unseen",))
    run_suite(planned, tmp_path / "results", SmallBackend())
    (entry,) = entries(tmp_path / "results")
    source = planned.function("ahead").policy.source
    assert (entry.trained, entry.missing, entry.made_by) == (False, (), f"ahead 1 ({source})")
    page = leaderboard([tmp_path / "results"])
    assert "No policy that sees frames has a complete row yet." in page
    section = page.partition("## Not trained here")[2]
    assert "| 1 | ahead (privileged) | results |" in section and f"| current; ahead 1 ({source}) |" in section


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            {"function": "mine.py"},
            "function must be a file or a module, and a name in it, such as fly.py:fly, got 'mine",
        ),
        ({"function": "nowhere.py:fly"}, "there is no file .*nowhere.py"),
        ({"name": "hover"}, "hover is named twice"),
    ],
)
def test_a_function_that_cannot_fly_is_refused_before_anything_runs(file: Path, given: dict, words: str):
    with pytest.raises(ResultsError, match=words):
        suite(file, policies=({"function": f"{file}:ahead", **given},))


def test_another_process_loads_the_function_itself(file: Path):
    sent = pickle.loads(pickle.dumps(Function(f"{file}:ahead", "Mine")))
    assert (sent.label, sent.policy.observation, sent.policy.function([0])) == ("Mine", "privileged", [1, 1, 0, 1])


@pytest.mark.slow
def test_a_function_comes_to_the_table_from_the_command_line(file: Path, tmp_path: Path):
    (tmp_path / "tiny.yaml").write_text(
        "arms: []\ntest_levels: [Easy]\nepisodes: 2\nbaselines: [forward]\npackaged: false\nfilm: false\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    for words in (
        ["evaluate", "mine.py:ahead", "--levels", "easy", "--episodes", "2", "--out", "rows.csv"],
        ["bench", "tiny.yaml", "--policy", "mine.py:ahead", "--out", "results", "--jobs", "2"],
    ):
        done = subprocess.run(
            [sys.executable, "-m", "thalweg", *words], cwd=tmp_path, env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert "ahead" in done.stdout
    rows = [
        list(csv.DictReader((tmp_path / name).read_text().splitlines()))
        for name in ("rows.csv", "results/evaluation/ahead-0-Easy.csv")
    ]
    assert rows[0] == rows[1]
    assert [(row["algorithm"], row["version"], len(row["source"])) for row in rows[0]] == [("ahead", "1", 16)] * 2
    assert "| ahead " in (tmp_path / "results" / "report" / "table.md").read_text()
