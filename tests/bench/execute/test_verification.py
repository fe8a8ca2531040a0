"""Tests of the verification of recorded results: what agrees, what differs, and what cannot be compared."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.bench.small_backend import SUITE, SmallBackend
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.runner import run_suite
from thalweg.bench.execute.verification import verify
from thalweg.bench.results.run_versions import read_versions, write_versions
from thalweg.bench.suite.arms import Run
from thalweg.cli.bench import verification_lines
from thalweg.cli.main import main
from thalweg.train.folder.run_record import write_config

pytestmark = pytest.mark.usefixtures("no_pictures")
ONLY = ("PPO-0",)


class RecordingBackend(SmallBackend):
    """Leaves a curve with costs, and the machine, in a run's folder."""

    def __init__(self, cpu: str = "A", returns: tuple[float, ...] = (1.5, 2.5)) -> None:
        super().__init__()
        self.cpu, self.returns = cpu, returns

    def train(self, run: Run, folder: Path) -> None:
        super().train(run, folder)
        rows = "".join(f"{90 + i},{value},0.0,0.0,0.0\n" for i, value in enumerate(self.returns, start=1))
        (folder / "episodes.csv").write_text(f"step,return,cost,tight,loose\n{rows}")
        write_config(folder, {"run": {}, "machine": {"cpu": self.cpu, "learning_threads": 1}})


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    folder = tmp_path / "recorded"
    run_suite(SUITE, folder, RecordingBackend())
    return folder


def test_a_run_that_is_made_again_agrees_to_the_bit(recorded: Path, tmp_path: Path):
    again = RecordingBackend()
    (outcome,) = verify(SUITE, recorded, tmp_path / "repeated", ONLY, again)
    assert outcome.reproduced and outcome.conditions == ()
    assert [(part.name, part.episodes) for part in outcome.parts] == [
        ("curve", 2),
        ("Easy", 3),
        ("Medium", 3),
        ("Hard", 3),
    ]
    assert [call for call in again.calls if "train" in call] == ["train PPO-0"]
    assert not (tmp_path / "repeated" / "report").exists()


def test_a_run_whose_episodes_are_not_kept_is_compared_by_its_curve(recorded: Path, tmp_path: Path):
    for path in recorded.glob("runs/*/episodes.csv"):
        path.unlink()
    (outcome,) = verify(SUITE, recorded, tmp_path / "repeated", ONLY, RecordingBackend())
    assert outcome.reproduced and (outcome.parts[0].name, outcome.parts[0].episodes) == ("curve", 2)
    assert "  curve, 2 episodes: the same to the bit" in verification_lines(outcome, recorded, tmp_path / "repeated")
    (outcome,) = verify(SUITE, recorded, tmp_path / "other", ONLY, RecordingBackend(returns=(1.5, 2.25)))
    assert outcome.parts[0].differences == ("line 2: return 2.0 there, 1.875 here",)


def test_a_changed_number_in_the_flights_is_found_and_named(recorded: Path, tmp_path: Path):
    path = recorded / "evaluation" / "PPO-0-Medium.csv"
    header, first, *rest = path.read_text().splitlines()
    column = header.split(",").index("return")
    values = first.split(",")
    before, values[column] = values[column], "7.25"
    path.write_text("\n".join([header, ",".join(values), *rest]) + "\n")
    (outcome,) = verify(SUITE, recorded, tmp_path / "repeated", ONLY, RecordingBackend())
    assert not outcome.reproduced
    assert {part.name: part.differences for part in outcome.parts if part.differences} == {
        "Medium": (f"line 2: return 7.25 there, {before} here",)
    }
    lines = verification_lines(outcome, recorded, tmp_path / "repeated")
    assert lines[-1] == "PPO-0: NOT reproduced"
    assert f"  Medium, 3 episodes: line 2: return 7.25 there, {before} here" in lines


def test_another_curve_on_the_same_processor_differs(recorded: Path, tmp_path: Path):
    (outcome,) = verify(SUITE, recorded, tmp_path / "repeated", ONLY, RecordingBackend(returns=(1.5, 2.5000001)))
    assert outcome.parts[0].differences == ("line 3: return 2.5 there, 2.5000001 here",)


@pytest.mark.parametrize(("returns", "agrees"), [((1.6, 2.6), True), ((4.0, 4.0), False)])
def test_on_another_processor_means_are_compared(
    returns: tuple[float, float], agrees: bool, recorded: Path, tmp_path: Path
):
    other = RecordingBackend("B", returns)
    (outcome,) = verify(SUITE, recorded, tmp_path / "repeated", ONLY, other)
    assert outcome.conditions == ("cpu A there, B here",)
    assert outcome.reproduced == agrees
    lines = verification_lines(outcome, recorded, tmp_path / "repeated")
    assert "made under other conditions (cpu A there, B here)" in lines[1]


def test_policies_without_training_are_flown_again(recorded: Path, tmp_path: Path):
    (outcome,) = verify(SUITE, recorded, tmp_path / "repeated", ("hover",), RecordingBackend())
    assert outcome.reproduced and [part.name for part in outcome.parts] == ["Easy", "Medium", "Hard"]


def test_an_interrupted_verification_resumes(recorded: Path, tmp_path: Path):
    verify(SUITE, recorded, tmp_path / "repeated", ONLY, RecordingBackend())
    again = RecordingBackend()
    verify(SUITE, recorded, tmp_path / "repeated", ONLY, again)
    assert again.calls == []


def test_a_folder_that_lacks_other_runs_of_the_suite_is_verified(recorded: Path, tmp_path: Path):
    larger = replace(SUITE, arms=(*SUITE.arms, replace(SUITE.arms[0], name="another")), baselines=("hover", "pilot"))
    assert verify(larger, recorded, tmp_path / "repeated", ONLY, RecordingBackend())[0].reproduced


def test_another_suite_is_refused_before_anything_is_trained(recorded: Path, tmp_path: Path):
    again = RecordingBackend()
    with pytest.raises(ResultsError, match=r"belongs to another suite: episodes is 3 there and 4 here"):
        verify(replace(SUITE, episodes=4), recorded, tmp_path / "repeated", ONLY, again)
    arms = (replace(SUITE.arms[0], steps=99), SUITE.arms[1])
    with pytest.raises(ResultsError, match=r"arms\.PPO\.steps is 100 there and 99 here"):
        verify(replace(SUITE, arms=arms), recorded, tmp_path / "repeated", ONLY, again)
    assert again.calls == [] and not (tmp_path / "repeated").exists()


def test_what_cannot_be_compared_is_refused(recorded: Path, tmp_path: Path):
    def refused(words: str, repeated: Path = tmp_path / "repeated", there: Path = recorded) -> None:
        with pytest.raises(ResultsError, match=words):
            verify(SUITE, there, repeated, ONLY, RecordingBackend())
        assert not (tmp_path / "repeated").exists()

    refused("is the folder to verify", repeated=recorded)
    refused("holds no results to verify", there=tmp_path / "nothing")
    versions = read_versions(recorded)
    write_versions(recorded, versions | {"PPO-0": {**versions["PPO-0"], "PPO": 0}})
    refused("PPO-0 cannot be verified: it was made with PPO 0")
    write_versions(recorded, versions)
    (recorded / "evaluation" / "PPO-0-Hard.csv").unlink()
    refused("there is no .*PPO-0-Hard.csv")
    runs = (recorded / "runs.csv").read_text()
    (recorded / "runs.csv").write_text(runs.replace("PPO-0,train,PPO,0,0,finished", "PPO-0,train,PPO,0,0,failed"))
    refused("PPO-0 cannot be verified: in .* it is failed")


def test_the_command_tells_what_it_needs(tmp_path: Path, capsys: pytest.CaptureFixture):
    assert main(["bench", "quick", "--verify", str(tmp_path)]) == 2
    assert "--verify makes runs again: name them by --only" in capsys.readouterr().err
    assert main(["bench", "quick"]) == 2
    assert "give the folder of the results, such as --out" in capsys.readouterr().err


def test_the_status_of_the_command_says_whether_the_run_is_reproduced(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    suite = tmp_path / "small.yaml"
    suite.write_text(json.dumps(SUITE.as_data()))
    monkeypatch.setattr("thalweg.bench.execute.verification.RiverBackend", lambda _: RecordingBackend())
    monkeypatch.chdir(tmp_path)
    command = ["bench", str(suite), "--only", "PPO-0", "--verify", str(recorded), "--jobs", "1"]
    assert main(command) == 0
    out = capsys.readouterr().out
    assert "compared to the bit" in out and "PPO-0: reproduced" in out
    assert (tmp_path / "recorded-verified" / "runs" / "PPO-0").is_dir()
    curve = recorded / "runs" / "PPO-0" / "episodes.csv"
    curve.write_text(curve.read_text().replace("2.5", "2.75"))
    assert main(command) == 1
    assert "curve, 2 episodes: line 3: return 2.75 there, 2.5 here" in capsys.readouterr().out
