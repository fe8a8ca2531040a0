"""Tests of complete runs: resuming after an interruption, and their logs."""

from pathlib import Path
from typing import Any

import pytest

from tests.algos.offpolicy.learners import NAMES
from tests.train.small_runs import Stop, StopsAt, numbers, rows_of
from tests.train.toys import Walk
from thalweg.algos import LimitWarning
from thalweg.train import load_policy, run

SMALL = {
    "steps_per_collection": 32,
    "steps_per_update": 256,
    "minibatch": 16,
    "hidden": (8,),
    "random_steps": 100,
    "replay_size": 400,
}
"""The replay buffer is full before the run ends."""
VARIANTS: dict[str, dict[str, Any]] = {
    "frames": {"frame_stack": 3, "adapter": "box_scaled"},
    "separate costs": {"cost_limits": [0.05, 0.1], "cost_critics": 2},
}


def train(folder: Path, name: str, env: Walk | None = None, **config: Any):
    return run(name, env or Walk(), steps=600, seed=3, folder=folder, config=SMALL | config, checkpoint_seconds=0.0)


@pytest.mark.parametrize("config", VARIANTS.values(), ids=list(VARIANTS))
@pytest.mark.parametrize("name", NAMES)
def test_a_resumed_run_ends_with_the_same_numbers(name: str, config: dict[str, Any], tmp_path: Path):
    train(tmp_path / "uninterrupted", name, **config)
    for at in (37, 101):  # a checkpoint after every 8 vector steps; reports after every 64
        folder = tmp_path / str(at)
        with pytest.raises(Stop):
            train(folder, name, StopsAt(at), **config)
        result = train(folder, name, **config)
        assert result.resumed_from == (at - 1) // 8 * 32
        assert numbers(folder) == numbers(tmp_path / "uninterrupted")


@pytest.mark.parametrize("name", NAMES)
def test_a_run_writes_a_policy_and_a_row_for_each_report(name: str, tmp_path: Path):
    train(tmp_path, name)
    rows = rows_of(tmp_path, "metrics.csv")
    assert [int(row["steps"]) for row in rows] == [256, 512, 600]
    assert [int(row["replay"]) for row in rows] == [256, 400, 400]
    assert int(rows[-1]["gradient_steps"]) == 125  # a quarter of the 500 steps after the random ones
    assert sum(int(row["cost_episodes"]) for row in rows) == len(rows_of(tmp_path, "episodes.csv"))
    assert load_policy(tmp_path).greedy is False


@pytest.mark.parametrize("name", NAMES)
def test_the_paper_preset_runs_and_its_multiplier_stays_constant(name: str, tmp_path: Path):
    config = {"hidden": (8,), "minibatch": 16, "random_steps": 50, "steps_per_update": 100}
    with pytest.warns(LimitWarning, match="the cost limit 25 has not bound anything"):
        run(name, Walk(), steps=300, seed=0, folder=tmp_path, preset="paper", config=config)
    rows = rows_of(tmp_path, "metrics.csv")
    assert [float(row["multiplier"]) for row in rows] == [0.001] * 3 and int(rows[-1]["gradient_steps"]) == 250
    assert float(rows[-1]["multiplier_reach"]) == 0.001
