"""Tests that files of an earlier version of Thalweg still load with the same content.

They were written before modules were moved and renamed, and are never written anew.
"""

import csv
import json
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.train.small_runs import train
from tests.train.toys import Walk
from thalweg.bench.results.reading import read_results
from thalweg.encoder import DEFAULT_PATH, load_encoder
from thalweg.train import load_policy
from thalweg.train.errors import TrainingError
from thalweg.train.folder.checkpoint import load_checkpoint
from thalweg.train.rollouts.episodes import EpisodeStatistics
from thalweg.world import World

FOLDER = Path(__file__).resolve().parent / "written_by_0_1_0"


def rows_of(path: Path) -> list[dict[str, str]]:
    with open(path) as file:
        return list(csv.DictReader(file))


def test_a_world_loads():
    world = World.load(FOLDER / "world.npz")
    assert str(world) == "World('handmade', seed 0: a loop of 126 m, 0 bridges, 0 islands, 0 plants)"
    assert world.ground_m.shape == (64, 64) and world.ground_m[0, 63] == pytest.approx(-0.37)
    assert int(world.sun[0, 0]) == 200


@pytest.mark.parametrize("name", ["FOCOPS", "SACLag", "CCEPETS", "PPO"])
def test_a_policy_chooses_the_same_actions(name: str):
    """The policy of PPO has a GRU; CCEPETS plans with a model."""
    obs = np.random.default_rng(0).standard_normal((16, 3)).astype(np.float32)
    policy = load_policy(FOLDER / "policies" / f"{name}.safetensors")
    player = policy.player(16, generator=torch.Generator().manual_seed(0))
    taken = json.loads((FOLDER / "actions.json").read_text())[name]
    assert np.asarray(player(obs, np.ones(16, dtype=bool))).tolist() == taken


def test_an_interrupted_run_with_other_defaults_is_refused_and_left_alone(tmp_path: Path):
    shutil.copytree(FOLDER / "run", tmp_path / "run")
    with pytest.raises(TrainingError, match=r"config.multiplier_rate is 1.0 there and .* here"):
        train(tmp_path / "run", "FOCOPS", Walk(), steps=1500)
    for path in filter(Path.is_file, (FOLDER / "run").rglob("*")):
        assert (tmp_path / path.relative_to(FOLDER)).read_bytes() == path.read_bytes()


def test_the_episodes_of_a_checkpoint_are_read(tmp_path: Path):
    shutil.copytree(FOLDER / "run", tmp_path / "run")
    found = load_checkpoint(tmp_path / "run")
    assert found is not None
    saved = found[1]["book"]
    saved["fresh"] = saved["recent"][-2:]  # as after an update that had nothing to report
    statistics = EpisodeStatistics(2, ["", ""])
    statistics.load_state(saved)
    assert saved["recent"] and [asdict(episode) for episode in statistics.since_update] == saved["fresh"]


def test_results_of_a_suite_are_read():
    results = read_results(FOLDER / "suite")
    assert results.suite["name"] == "easy"
    assert {row.status for row in results.runs} == {"finished"}
    assert sum(row.algorithm.startswith("PPO") for row in results.episodes) == 60
    assert np.mean([row.return_ for row in results.episodes if row.algorithm.startswith("hover")]) < 0.1


def test_the_packaged_encoder_is_unchanged():
    assert load_encoder(DEFAULT_PATH)(np.zeros((1, 128, 128, 4), np.uint8)).shape == (1, 16)
