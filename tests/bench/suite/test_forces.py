"""Tests of suites in hard mode, and under wind, current and inertia."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import SHIELDED
from thalweg.bench.execute.backend import RiverBackend
from thalweg.bench.execute.runner import claim
from thalweg.bench.results.run_versions import UNKNOWN, current_versions, needs_training, version_label
from thalweg.bench.suite.arms import Arm
from thalweg.bench.suite.builtin import load_suite
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.record import has_forces, read_suite
from thalweg.core import versions
from thalweg.env.forces.options import ForceOptions
from thalweg.env.physics.wind import Wind

OWN = Suite("own", (Arm("PPO"),), packaged=False)
BLOWN = """
name: blown
arms: [{algorithm: PPO}]
packaged: false
forces:
  wind: {speed_m_per_s: [1, 3], towards_deg: 90}
  current_m_per_s: 0.5
"""


def test_a_file_says_what_moves_the_vehicle(tmp_path: Path):
    (tmp_path / "blown.yaml").write_text(BLOWN)
    suite = load_suite(str(tmp_path / "blown.yaml"))
    assert suite.forces == ForceOptions(
        wind=Wind(speed_m_per_s=(1.0, 3.0), towards_deg=(90.0, 90.0)), current_m_per_s=(0.5, 0.5)
    )
    flown = RiverBackend(suite).config(suite.trials(suite.runs()[0])[0]).env
    assert flown.wind == suite.forces.wind and flown.observation == "none"
    claim(tmp_path / "results", suite)
    record = read_suite(tmp_path / "results")
    assert record["forces"]["current_m_per_s"] == [0.5, 0.5] and has_forces(record)
    claim(tmp_path / "results", suite)  # which is resumed
    with pytest.raises(ResultsError, match="forces"):
        claim(tmp_path / "results", replace(suite, forces=ForceOptions()))


def test_suites_in_still_air_are_written_as_before():
    data = OWN.as_data()
    assert "forces" not in data and "hard" not in data and not has_forces(data)
    hard = replace(OWN, task="Swimmers", hard=True)
    assert hard.as_data()["hard"] is True and hard.rules.hard
    assert json.loads(json.dumps(replace(OWN, forces=ForceOptions(current_m_per_s=(0.1, 0.2))).as_data()))[
        "forces"
    ] == {"current_m_per_s": [0.1, 0.2]}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"hard": True}, "hard must be False in the task River"),
        ({"forces": {"wind": {"speed_m_per_s": 40}}}, "pushes the vehicle by up to"),
        ({"forces": {"winds": {}}}, r"forces has no 'winds'"),
        ({"forces": {"carried_by_current": True}}, "needs a current"),
        ({"forces": {"dynamics": "inertial"}, "packaged": True}, "set packaged: false"),
        ({"forces": {"dynamics": "inertial"}, "conditions": (SHIELDED,)}, "condition shield: the shield judges no"),
        ({"forces": {"dynamics": "inertial"}, "task": "Swimmers"}, "dynamics must be kinematic in the task Swimmers"),
    ],
)
def test_what_does_not_go_together_is_refused(changes: dict, message: str):
    with pytest.raises(ResultsError, match=message):
        replace(OWN, **changes)


@pytest.mark.parametrize("kind", ["train", "baseline", "packaged"])
def test_results_under_forces_depend_on_their_version(kind: str):
    usual = current_versions(kind, ["PPO"])
    assert "forces" not in usual
    assert current_versions(kind, ["PPO"], forces=True) == usual | {"forces": versions.FORCES}


def test_only_results_of_frames_depend_on_the_objects_that_they_show():
    for task, shows in (("River", False), ("RacingLine", False), ("Swimmers", True), ("Portage", True)):
        for kind, seen in (("train", "frames"), ("train", "rgb"), ("packaged", "frames")):
            found = current_versions(kind, ["PPO"], task=task, observation=seen)
            assert found.get("props") == (versions.PROPS if shows else None)
    assert "props" not in current_versions("train", ["PPO"], task="Nests", observation="privileged")
    assert "props" not in current_versions("baseline", ["pilot"], task="Nests")


def test_only_trained_results_of_other_tasks_depend_on_deadlines():
    for task, kind, depends in (
        ("River", "train", False),
        ("Nests", "train", True),
        ("Swimmers", "baseline", False),
        ("Portage", "packaged", False),
        ("RacingLine", "function", False),
    ):
        found = current_versions(kind, ["PPO"] if kind == "train" else ["pilot"], task=task)
        assert found.get("deadlines") == (versions.DEADLINES if depends else None)


def test_a_run_from_before_a_version_is_told_by_it():
    now = current_versions("train", ["PPO"], task="Nests")
    before = {name: version for name, version in now.items() if name != "deadlines"}
    assert version_label(now, now) == "" and version_label({}, now) == UNKNOWN
    assert version_label(before, now) == f"before deadlines {versions.DEADLINES}"
    assert version_label(before | {"PPO": 0}, now) == "PPO 0"
    assert needs_training(before, now)


def test_results_of_the_paper_have_the_versions_that_they_had():
    assert set(current_versions("train", ["PPO"])) == {
        "world",
        "rules",
        "evaluation",
        "render",
        "encoder",
        "training",
        "PPO",
    }
