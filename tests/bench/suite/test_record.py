"""Reading of `suite.json`: a damaged record is not used, and the message names what is wrong."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.bench.small_backend import SUITE, SmallBackend
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.runner import run_suite
from thalweg.bench.report.report import write_report
from thalweg.bench.results.reading import read_results
from thalweg.bench.suite.record import read_suite
from thalweg.cli.main import main

pytestmark = pytest.mark.usefixtures("no_pictures")

ROOT = Path(__file__).resolve().parents[3]
BASE = {"name": "x", "train_level": "Medium"}
ARM = {"name": "PPO", "algorithm": "PPO", "seeds": [0, 1], "steps": 400}
CONDITION = {"name": "unseen", "levels": [], "rivers": {}, "blind": True}
NO_RECORD = "suite.json is not the record of a suite: "
DAMAGED: list[tuple[Any, str]] = [
    ([], "it must be a mapping, got []"),
    ("x" * 1000, f'it must be a mapping, got "{"x" * 199}...'),
    ({"train_level": "Medium", "arms": [ARM]}, "name is missing"),
    ({"name": "x", "arms": [ARM]}, "train_level is missing"),
    (BASE | {"train_level": ["Medium"]}, 'train_level must be a string, got ["Medium"]'),
    (BASE | {"arms": None}, "arms must be a list, got null"),
    (BASE | {"views": {"camera": 5}}, 'views must be those of a suite, got {"camera": 5}'),
    (
        BASE | {"views": {"camera": {"fov_deg": "wide"}}},
        'views must be those of a suite, got {"camera": {"fov_deg": "wide"}}',
    ),
    (BASE | {"arms": "PPO"}, 'arms must be a list, got "PPO"'),
    (BASE | {"arms": ["PPO"]}, 'arms[0] must be a mapping, got "PPO"'),
    (
        BASE | {"arms": [{}]},
        "arms[0].name is missing; arms[0].algorithm is missing; arms[0].seeds is missing; and 1 more",
    ),
    (BASE | {"arms": [ARM, ARM | {"name": None}]}, "arms[1].name must be a string, got null"),
    (BASE | {"arms": [ARM | {"algorithm": ["PPO"]}]}, 'arms[0].algorithm must be a string, got ["PPO"]'),
    (BASE | {"arms": [ARM | {"seeds": 3}]}, "arms[0].seeds must be a list, got 3"),
    (BASE | {"arms": [ARM | {"seeds": [0, [1]]}]}, "arms[0].seeds[1] must be a whole number, got [1]"),
    (BASE | {"arms": [ARM | {"seeds": [True]}]}, "arms[0].seeds[0] must be a whole number, got true"),
    (BASE | {"arms": [ARM | {"steps": "many"}]}, 'arms[0].steps must be a whole number, got "many"'),
    (BASE | {"arms": [ARM | {"before": [{}]}]}, "arms[0].before[0].steps is missing"),
    (BASE | {"algorithms": ["PPO"], "seeds": 3}, "seeds must be a list, got 3"),
    (BASE | {"algorithms": [["PPO"]]}, 'algorithms[0] must be a string, got ["PPO"]'),
    (BASE | {"arms": [ARM], "test_levels": [["Easy"]]}, 'test_levels[0] must be a string, got ["Easy"]'),
    (BASE | {"arms": [ARM], "baselines": None}, "baselines must be a list, got null"),
    (BASE | {"arms": [ARM], "conditions": ["a"]}, 'conditions[0] must be a mapping, got "a"'),
    (
        BASE | {"arms": [ARM], "conditions": [{"name": "a"}]},
        "conditions[0].levels is missing; conditions[0].rivers is missing; conditions[0].blind is missing",
    ),
    (
        BASE | {"arms": [ARM], "conditions": [CONDITION | {"rivers": 1}]},
        "conditions[0].rivers must be a mapping, got 1",
    ),
    (
        BASE | {"arms": [ARM], "conditions": [CONDITION | {"name": "../runs"}]},
        'conditions[0]: name must be letters, digits, - and ., got "../runs"',
    ),
    (
        BASE | {"arms": [ARM], "conditions": [CONDITION, CONDITION]},
        'conditions[1]: name must be one of its own, got "unseen" twice',
    ),
    (BASE | {"arms": [ARM], "made_by": "me"}, 'made_by must be a mapping, got "me"'),
]


@pytest.mark.parametrize(("damaged", "said"), DAMAGED, ids=[said for _, said in DAMAGED])
def test_a_damaged_record_is_ignored_and_the_report_says_why(
    tiny_results: Path, damaged: Any, said: str, capsys: pytest.CaptureFixture
):
    (tiny_results / "suite.json").write_text(json.dumps(damaged))
    found = read_results(tiny_results)
    assert (found.suite, found.skipped) == ({}, [NO_RECORD + said])
    assert f"Not used: {NO_RECORD}{said}" in write_report(tiny_results).problems
    assert main(["leaderboard", str(tiny_results)]) == 2
    assert f"{NO_RECORD}{said}" in capsys.readouterr().err


def test_without_a_record_episodes_under_conditions_are_named_together(tiny_results: Path):
    for name in ("unseen", "haze"):
        shutil.copytree(
            tiny_results / "evaluation",
            tiny_results / "evaluation" / name,
            ignore=shutil.ignore_patterns(name, "unseen"),
        )
    (tiny_results / "suite.json").write_text("{")
    found = read_results(tiny_results)
    assert found.episodes and not found.condition_episodes
    unreadable, unknown = found.skipped
    assert unreadable.startswith("suite.json cannot be read: ")
    assert unknown == "evaluation: flights under haze, unseen, for without suite.json no condition is known"


def test_a_results_path_that_is_a_file_is_refused(tmp_path: Path):
    (tmp_path / "file").write_text("mine")
    for place in (tmp_path / "file", tmp_path / "file" / "below" / "it"):
        with pytest.raises(ResultsError, match="file is not a folder; give a new folder for the suite"):
            run_suite(SUITE, place, SmallBackend())
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize(("damaged", "said"), DAMAGED, ids=[said for _, said in DAMAGED])
def test_results_with_a_damaged_record_are_not_resumed(tmp_path: Path, damaged: Any, said: str):
    (tmp_path / "suite.json").write_text(json.dumps(damaged))
    place = SmallBackend()
    with pytest.raises(ResultsError) as refused:
        run_suite(SUITE, tmp_path, place)
    assert str(refused.value) == f"{tmp_path} cannot be resumed: {NO_RECORD}{said}; choose another folder"
    assert place.calls == []


def test_a_long_value_is_shortened_in_the_message(tiny_results: Path):
    (tiny_results / "suite.json").write_text(json.dumps(BASE | {"arms": {"PPO": "x" * 1000}}))
    (line,) = read_results(tiny_results).skipped
    assert line == f'{NO_RECORD}arms must be a list, got {{"PPO": "{"x" * 71}...'


@pytest.mark.parametrize(
    ("content", "said"),
    [(b"{", "Expecting property name"), (b"\xff", "'utf-8' codec"), (b"[" * 100_000, "maximum recursion depth")],
)
def test_a_file_that_is_not_json_is_ignored(tiny_results: Path, content: bytes, said: str):
    (tiny_results / "suite.json").write_bytes(content)
    (line,) = read_results(tiny_results).skipped
    assert line.startswith(f"suite.json cannot be read: {said}")


def test_a_record_without_arms_does_not_fit_trained_runs(tiny_results: Path):
    (tiny_results / "suite.json").write_text(json.dumps(BASE | {"arms": []}))
    found = read_results(tiny_results)
    assert found.suite == {}
    assert found.skipped == ["suite.json names no algorithm, but runs.csv has runs of PPO that were trained"]
    assert write_report(tiny_results).page.exists()


@pytest.mark.parametrize(
    "folder", ["benchmarks/paper", "benchmarks/open", "benchmarks/easy", "tests/bench/tiny_results"]
)
def test_the_committed_records_are_valid(folder: str):
    assert read_suite(ROOT / folder) == json.loads((ROOT / folder / "suite.json").read_text())


def test_unknown_keys_of_a_record_are_kept(tmp_path: Path):
    record = BASE | {"arms": [ARM | {"colour": 3}], "new": None}
    (tmp_path / "suite.json").write_text(json.dumps(record))
    assert read_suite(tmp_path) == record
