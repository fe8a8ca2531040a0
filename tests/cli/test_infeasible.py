"""Tests of impossible runs: they are refused, or warned of, by name, before the first step, by every command that would
try one."""

import warnings
from pathlib import Path

import pytest

from tests.plugins import no_plugins  # noqa: F401  (a fixture)
from thalweg.algos import LimitWarning
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute import runner
from thalweg.cli.main import main
from thalweg.train.river import RiverTraining

pytestmark = pytest.mark.usefixtures("no_plugins")
HURRIED = """
from dataclasses import replace

from thalweg.env import TaskPlugin
from thalweg.env.tasks import TASKS

PLUGIN = TaskPlugin("Hurried", replace(TASKS["Swimmers"], deadline_steps_per_m=0.2), "no time", version=1)
"""
STILL = ["--observation", "privileged"]
TRAIN = ["train", "PPOLag", *STILL, "--level", "Easy", "--out", "{out}"]
EVALUATE = ["evaluate", "hover", "--levels", "Easy", "--episodes", "1", "--out", "{out}.csv"]
BENCH = ["bench", "{out}.yaml", "--out", "{out}", "--jobs", "1"]
ORACLE = ["oracle", "--levels", "Easy", "--episodes", "1", "--out", "{out}.csv"]
SUITE = """
name: own
arms: [{algorithm: PPOLag, seeds: [0], steps: 2048}, {algorithm: CPO, seeds: [0], steps: 2048}]
train_level: Medium
test_levels: [Easy]
baselines: []
packaged: false
observation: privileged
"""


@pytest.fixture
def out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where results would be written, beside a suite and a task."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hurried.py").write_text(HURRIED)
    (tmp_path / "out.yaml").write_text(SUITE)
    return tmp_path / "out"


def refusal(command: list[str], out: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What a command says that must be refused and leave nothing behind."""
    assert main([word.format(out=out) for word in command]) == 2
    assert not out.exists() and not out.with_suffix(".csv").exists()
    return capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [
        [*TRAIN, "--task", "Hurried"],
        [*EVALUATE, "--task", "Hurried"],
        [*BENCH, "--task", "Hurried"],
        [*ORACLE, "--tasks", "Hurried"],
    ],
    ids=lambda command: command[0],
)
def test_a_deadline_that_nobody_can_meet(command: list[str], out: Path, capsys: pytest.CaptureFixture[str]):
    told = refusal([*command, "--plugin", "hurried.py"], out, capsys)
    assert "nobody can meet the deadline of Hurried on " in told
    assert "deadline_steps_per_m of the task must be at least 0.4" in told and "got 0.2" in told


@pytest.mark.parametrize("command", [TRAIN, EVALUATE, BENCH], ids=lambda command: command[0])
@pytest.mark.parametrize(
    ("forces", "told"),
    [
        (
            ["--wind", "40"],
            "wind.speed_m_per_s = 40 pushes the vehicle by up to 9.47 m/s in gusts, but it flies sideways",
        ),
        (["--current", "9", "--carried-by-current"], "= 9 is faster than the vehicle; the greatest that it holds"),
    ],
)
def test_wind_or_current_that_the_vehicle_cannot_hold_against(
    command: list[str], forces: list[str], told: str, out: Path, capsys: pytest.CaptureFixture[str]
):
    assert told in refusal([*command, *forces], out, capsys)


@pytest.mark.parametrize(
    "command",
    [
        ["train", "PPO", *STILL, "--vehicle", "asv", "--level", "Hard", "--out", "{out}"],
        ["evaluate", "hover", "--vehicle", "asv", "--levels", "Hard", "--out", "{out}.csv"],
    ],
    ids=lambda command: command[0],
)
def test_a_boat_that_does_not_fit_the_river(command: list[str], out: Path, capsys: pytest.CaptureFixture[str]):
    told = refusal(command, out, capsys)
    assert "the boat (2 m by 1.08 m, draught 0.32 m) does not fit Hard-1: at arc 395 m" in told


BELOW = (
    r"cost_limit=0.5 is below the oracle's safest point in RacingLine on Medium, a cost of 0.998 at a return of 1.33"
)


def test_train_warns_of_a_limit_below_the_oracles_safest_point(out: Path, monkeypatch: pytest.MonkeyPatch):
    command = ["train", "PPOLag", *STILL, "--task", "RacingLine", "--level", "medium", "--out", str(out)]

    def begin(*_: object, **__: object) -> None:
        raise ResultsError("training would begin here")

    monkeypatch.setattr(RiverTraining, "train", begin)
    for banks in ([], ["--banks", "meadow"]):  # the rules know none
        with pytest.warns(LimitWarning, match=f"^PPOLag: {BELOW}"):
            assert main([*command, "--set", "cost_limit=0.5", *banks]) == 2
    for other in (["--set", "cost_limit=1.2"], ["--hard", "--set", "cost_limit=0.5"]):
        with warnings.catch_warnings():
            warnings.simplefilter("error", LimitWarning)
            assert main([*command, *other]) == 2


def test_bench_warns_of_limits_below_the_oracles_safest_point(out: Path, monkeypatch: pytest.MonkeyPatch):
    limited = SUITE.replace("PPOLag,", "PPOLag, settings: {cost_limit: 0.5},").replace(
        "CPO,", "CPO, settings: {cost_limit: 0.5},"
    )
    out.with_suffix(".yaml").write_text(limited)
    command = ["bench", str(out.with_suffix(".yaml")), "--task", "RacingLine", "--out", str(out), "--jobs", "1"]

    def begin(*_: object, **__: object) -> None:
        raise ResultsError("runs would begin here")

    monkeypatch.setattr(runner, "execute_runs", begin)
    with pytest.warns(LimitWarning, match=f"^PPOLag, CPO: {BELOW}"):
        assert main(command) == 2
    with pytest.warns(LimitWarning, match=f"^CPO: {BELOW}"):
        assert main([*command, "--only", "CPO"]) == 2
    with warnings.catch_warnings():
        warnings.simplefilter("error", LimitWarning)
        assert main([*command[:-4], "--out", str(out.with_name("hard")), "--hard"]) == 2
