"""Our own environment and a trainer: the parts fit, and a run on it can be broken off."""

import csv

import numpy as np
import pytest

from thalweg.env import DoneReason, EnvConfig, RiverVectorEnv
from thalweg.train import LatentVectorEnv, run
from thalweg.world import World

CONFIG = {"steps_per_update": 512, "passes": 2}


class Stop(Exception):
    pass


class Breaks(RiverVectorEnv):
    """Raises at a vector step."""

    at = 0

    def step(self, actions):
        self.at += 1
        if self.at == 150:
            raise Stop
        return super().step(actions)


def river(world: World, kind: type[RiverVectorEnv] = RiverVectorEnv) -> RiverVectorEnv:
    return kind([world], 8, EnvConfig(observation="none"))


def test_a_run_on_the_river_resumes_to_the_same_numbers(easy_world: World, tmp_path):
    given = {"steps": 2048, "seed": 1, "config": CONFIG, "checkpoint_seconds": 0.0}
    run("FOCOPS", river(easy_world), folder=tmp_path / "whole", **given)
    with pytest.raises(Stop):
        run("FOCOPS", river(easy_world, Breaks), folder=tmp_path / "broken", **given)
    assert run("FOCOPS", river(easy_world), folder=tmp_path / "broken", **given).resumed_from == 1024
    for name in ("episodes.csv", "policy.safetensors"):
        assert (tmp_path / "broken" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_episodes_of_the_river_name_reason_world_and_both_costs(easy_world: World, tmp_path):
    run("PPO", river(easy_world), steps=2048, seed=0, folder=tmp_path, config=CONFIG)
    with open(tmp_path / "episodes.csv") as file:
        rows = list(csv.DictReader(file))
    assert rows and {row["world"] for row in rows} == {f"{easy_world.name}-{easy_world.seed}"}
    assert {row["reason"] for row in rows} <= {reason.label for reason in DoneReason if reason >= 0}
    assert all(float(row["cost"]) == float(row["tight"]) + float(row["loose"]) for row in rows)
    assert any(float(row["tight"]) == 1.0 for row in rows)


class Colours:
    """The mean colour of a frame."""

    latent = 4

    def __call__(self, frames: np.ndarray) -> np.ndarray:
        return frames.mean((1, 2), dtype=np.float32) / 255


class Blank:
    """A renderer that draws the pose's x as a level of grey."""

    def __init__(self, camera) -> None:
        self.camera = camera

    def render(self, poses, world_index=None, time_s=None, out=None):
        frames = np.zeros((len(poses), self.camera.height_px, self.camera.width_px, 4), np.uint8)
        frames[:] = (np.abs(poses[:, 0]) % 256).astype(np.uint8)[:, None, None, None]
        return frames


def test_a_run_on_images_uses_the_encoder(easy_world: World, tmp_path):
    env = LatentVectorEnv(RiverVectorEnv([easy_world], 4, renderer=Blank(EnvConfig().camera)), Colours())
    result = run("FOCOPS", env, steps=300, seed=0, folder=tmp_path, config={"steps_per_update": 128})
    assert result.policy.obs_size == 4 and result.steps == 300
    with open(tmp_path / "metrics.csv") as file:
        assert all(float(row["time_encode"]) > 0 for row in csv.DictReader(file))
