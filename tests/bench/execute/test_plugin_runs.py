"""Runs of algorithms from outside the package in suites: their versions and sources, in workers and in reports."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tests.bench.small_backend import SUITE, SmallBackend
from tests.plugins import EXAMPLE, no_plugins  # noqa: F401  (a fixture)
from tests.train.small_runs import SMALL
from tests.train.toys import Walk
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.backend import installed_versions
from thalweg.bench.execute.cluster.node_task import RunRequest, run_on_node
from thalweg.bench.execute.executors import ProcessPoolExecutor
from thalweg.bench.execute.runner import run_suite
from thalweg.bench.leaderboard import entries
from thalweg.bench.report.report import problems
from thalweg.bench.report.suite_tables import algorithm_table
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.run_versions import current_sources, read_sources, read_versions
from thalweg.bench.suite.arms import Arm, Run
from thalweg.bench.suite.config import Suite
from thalweg.core.plugins.lookup import VARIABLE, add_files, file_contents, given_files
from thalweg.core.plugins.record import PluginWarning
from thalweg.train import run as train_run

pytestmark = pytest.mark.usefixtures("no_pictures", "no_plugins")
ARM = Arm("PricedPG", seeds=(0, 1), steps=100)


class Walking(SmallBackend):
    """Really trains the plug-in, on a toy."""

    def train(self, run: Run, folder: Path) -> None:
        self._call(f"train {run.name}")
        train_run(run.algorithm, Walk(), steps=256, seed=run.seed, folder=folder, config=SMALL)


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A copy of the example, which is used."""
    file = Path(shutil.copy(EXAMPLE, tmp_path / "mine.py"))
    add_files([file])
    return file


def suite() -> Suite:
    return replace(SUITE, arms=(ARM, Arm("PPO", seeds=(0,), steps=100)), test_levels=("Easy",))


def trained(backend: SmallBackend) -> list[str]:
    return [call.removeprefix("train ") for call in backend.calls if call.startswith("train ")]


def changed(file: Path, change: Callable[[str], str]) -> str:
    """Change a plug-in; returns the hash of its source."""
    file.write_text(change(file.read_text()))
    return current_sources(["PricedPG"])["PricedPG"]


def test_a_suite_names_a_plugin_as_any_other_algorithm(tmp_path: Path):
    with pytest.raises(ResultsError, match="unknown algorithm 'PricedPG'; known: PPO, "):
        suite()
    add_files([EXAMPLE])
    assert suite().algorithms_of(Run("train", "PricedPG", 0)) == ["PricedPG"]
    with pytest.raises(ResultsError, match=r"PricedPG: unknown setting of PricedPG 'prize'"):
        replace(suite(), arms=(replace(ARM, settings={"prize": 1}),))


def test_versions_bear_the_source_and_reports_name_the_method(mine: Path, tmp_path: Path):
    folder = tmp_path / "results"
    results = run_suite(suite(), folder, SmallBackend()).results
    source = current_sources(["PricedPG"])["PricedPG"]
    assert read_versions(folder)["PricedPG-0"]["PricedPG"] == 1
    assert read_sources(folder) == {"PricedPG-0": {"PricedPG": source}, "PricedPG-1": {"PricedPG": source}}
    assert json.loads((folder / "versions.json").read_text())["PricedPG-1"]["sources"] == {"PricedPG": source}
    methods = algorithm_table(results).text
    assert methods.iloc[0].tolist()[:4] == [
        "PricedPG",
        "on-policy",
        "not at all",
        "policy gradient at a fixed price of cost",
    ]
    assert methods["plug-in"].tolist() == [f"PricedPG 1 ({source})", "none"]
    assert (results.outdated, problems(results)) == ({}, [])
    backend = SmallBackend()
    run_suite(suite(), folder, backend)
    assert trained(backend) == []


def test_a_changed_source_is_a_warning_and_a_note_and_does_nothing_again(mine: Path, tmp_path: Path):
    folder, backend = tmp_path / "results", SmallBackend()
    run_suite(suite(), folder, SmallBackend())
    before = current_sources(["PricedPG"])["PricedPG"]
    now = changed(mine, lambda text: text + "CHANGED = True\n")
    with pytest.warns(
        PluginWarning, match=f"the source of PricedPG .* \\(its hash was {before}, and is {now} now"
    ) as found:
        run_suite(suite(), folder, backend)
    assert len([each for each in found if each.category is PluginWarning]) == 1
    assert trained(backend) == []
    assert read_sources(folder)["PricedPG-0"] == {"PricedPG": before}
    line = f"Changed: version 1 of the plug-in PricedPG has several sources ({before} and {now} now)"
    assert [each.split(":")[0] + ":" + each.split(":")[1] for each in problems(read_results(folder))] == [line]


def test_a_raised_version_does_its_runs_again_and_keeps_the_earlier_ones_apart(mine: Path, tmp_path: Path):
    folder, backend = tmp_path / "results", SmallBackend()
    run_suite(suite(), folder, SmallBackend())
    before = current_sources(["PricedPG"])["PricedPG"]
    now = changed(mine, lambda text: text.replace("version=1", "version=2"))
    assert set(read_results(folder).outdated) == {"PricedPG (PricedPG 1)"}
    assert [entry.versions for entry in entries(folder)] == ["PricedPG 1", "current"]
    assert read_results(folder).made_by("PricedPG") == f"PricedPG 1 ({before})"
    run_suite(suite(), folder, backend, only=("PricedPG-0",))
    assert trained(backend) == ["PricedPG-0"]
    sources = read_sources(folder)
    assert sources["PricedPG-0"] == {"PricedPG": now} and sources["PricedPG-1"] != {"PricedPG": now}
    results = read_results(folder)
    assert results.versions["PricedPG-1 (PricedPG 1)"]["PricedPG"] == 1
    made = [results.made_by(name) for name in ("PricedPG", "PricedPG (PricedPG 1)")]
    assert made == [f"PricedPG 2 ({now})", f"PricedPG 1 ({before})"]
    run_suite(suite(), folder, backend)
    assert trained(backend) == ["PricedPG-0", "PricedPG-1"]
    assert not (folder / "outdated").exists()


def test_results_can_be_read_without_the_plugin_and_say_so(mine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = tmp_path / "results"
    run_suite(suite(), folder, SmallBackend())
    monkeypatch.setenv(VARIABLE, "")
    results = read_results(folder)
    assert (results.outdated, "PricedPG" in results.policies) == ({}, True)
    assert problems(results) == [
        "Not compared: PricedPG is a plug-in that is not here; its results are shown as they are (--plugin FILE)"
    ]
    assert algorithm_table(results).text.iloc[0].tolist()[:4] == ["PricedPG", "unknown", "unknown", "unknown"]
    mine.write_text("x = ")
    monkeypatch.setenv(VARIABLE, str(mine))
    assert [line.partition("mine.py")[2] for line in problems(read_results(folder))] == [
        ", line 1: invalid syntax; a plug-in is a file of Python that can be imported"
    ]


@pytest.mark.slow
def test_processes_of_their_own_use_the_plugin(mine: Path, tmp_path: Path):
    folder = tmp_path / "results"
    outcome = run_suite(suite(), folder, Walking(), executor=ProcessPoolExecutor(2), only=("PricedPG",))
    assert [(row.run, row.status) for row in outcome.runs] == [("PricedPG-0", "finished"), ("PricedPG-1", "finished")]
    assert f"source: {current_sources(['PricedPG'])['PricedPG']}" in (
        (folder / "runs" / "PricedPG-1" / "config.yaml").read_text()
    )


def test_a_node_gets_the_file_with_its_run(mine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "prices.py").write_text("PRICE = 2.0\n")
    mine.write_text(f"import prices\n{mine.read_text()}")
    run, planned, sources = Run("train", "PricedPG", 0), suite(), current_sources(["PricedPG"])
    request = RunRequest(run, planned, Walking(), {}, installed_versions(), 0.0, file_contents(), sources)
    assert [(name, sorted(files)) for name, files in request.plugins] == [("mine.py", ["mine.py", "prices.py"])]
    monkeypatch.setenv(VARIABLE, "")
    updates = list(run_on_node(request))
    assert updates[-1].row is not None and updates[-1].row.status == "finished"
    assert [file.parent.parent == mine.parent for file in given_files()] == [False]
    monkeypatch.setenv(VARIABLE, "")
    other = replace(
        request, plugins=[(name, {**files, "prices.py": b"PRICE = 1.0\n"}) for name, files in request.plugins]
    )
    with pytest.raises(ResultsError, match=r"another plug-in PricedPG \(its source: \w{16} there, \w{16} here\)"):
        list(run_on_node(other))
