"""Suites from files: what a file may say, and what is said of what it may not."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from thalweg.bench.conditions import BEYOND, Condition
from thalweg.bench.files import ResultsError
from thalweg.bench.suite_files import suite_of
from thalweg.bench.suites import SUITES, Arm, Stage, Suite

MINE = """
arms:
  - {algorithm: FOCOPS, seeds: [0, 1], steps: 50000}
  - algorithm: PPOLag
    settings: {cost_limit: 0.05, hidden: [64, 64]}
    before: [{algorithm: PPO, level: Easy, steps: 1000}]
    name: strict
test_levels: [Easy]
episodes: 5
packaged: false
conditions: [real, {name: dusk, varied: [sun_elevation_deg], blind: false}]
"""


def written(folder: Path, text: str) -> str:
    (folder / "mine.yaml").write_text(text)
    return str(folder / "mine.yaml")


def test_a_file_says_what_the_dataclass_says(tmp_path: Path):
    strict = Arm(
        "PPOLag",
        settings={"cost_limit": 0.05, "hidden": [64, 64]},
        before=(Stage("PPO", "Easy", 1000),),
        name="strict",
    )
    real = next(condition for condition in BEYOND if condition.name == "real")
    assert suite_of(written(tmp_path, MINE)) == Suite(
        "mine",
        (Arm("FOCOPS", seeds=(0, 1), steps=50_000), strict),
        test_levels=("Easy",),
        episodes=5,
        packaged=False,
        conditions=(real, Condition("dusk", varied=("sun_elevation_deg",), blind=False)),
    )


@pytest.mark.parametrize("name", SUITES)
def test_every_suite_of_ours_can_be_written_as_a_file(name: str, tmp_path: Path):
    data = SUITES[name].as_data()
    for condition in data["conditions"]:
        condition["rivers"] = list(condition["rivers"])
    assert suite_of(written(tmp_path, yaml.safe_dump(data))).as_data() == SUITES[name].as_data()


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ([], "holds no suite: a mapping with arms is needed, got list"),
        ({}, "arms is missing"),
        ({"arms": [{}]}, r"arms\[0\]: algorithm is missing"),
        ({"arms": [], "epsiodes": 3}, r"there is no 'epsiodes' \(did you mean episodes\?\); there are name, arms"),
        ({"arms": "PPO"}, "arms must be a list, got 'PPO'"),
        ({"arms": ["PPO"]}, r"arms\[0\] must be a mapping, got 'PPO'"),
        ({"arms": [{"algorithm": "PPO", "steps": 2e5}]}, r"arms\[0\]: steps must be a whole number, got 200000.0"),
        ({"arms": [{"algorithm": "PPO", "seeds": [True]}]}, r"seeds\[0\] must be a whole number, got True"),
        ({"arms": [{"algorithm": "PPO", "settings": [1]}]}, r"settings must be a mapping, got \[1\]"),
        ({"arms": [], "packaged": 1}, "packaged must be true or false, got 1"),
        (
            {"arms": [], "conditions": ["fog"]},
            r"conditions\[0\]: unknown condition 'fog'; known: deterministic, unseen",
        ),
    ],
)
def test_what_a_file_says_wrongly_is_named_with_its_place(tmp_path: Path, data: Any, said: str):
    with pytest.raises(ResultsError, match=f"mine.yaml.*{said}"):
        suite_of(written(tmp_path, yaml.safe_dump(data)))


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path):
    with pytest.raises(ResultsError, match=r"other\.yaml can't be read: No such file"):
        suite_of(str(tmp_path / "other.yaml"))
    with pytest.raises(ResultsError, match=r"mine\.yaml is not YAML: .*line 1"):
        suite_of(written(tmp_path, "arms: ["))
