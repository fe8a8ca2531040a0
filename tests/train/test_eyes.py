"""Runs whose policies see images: they learn what they see, resume to the bit, and refuse what they cannot see."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
import yaml
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from tests.algos.onpolicy.test_learners import ON_POLICY
from tests.image_policies import image_policy
from tests.train.bright_side import SIZE, BrightSide, OneBrightSide, Stop, StopsAt
from tests.train.small_runs import numbers, rows_of
from tests.train.toys import Walk
from thalweg.algos import ALGORITHMS, AlgorithmError
from thalweg.core.compute.device import DeviceError
from thalweg.train import TrainingError, run
from thalweg.train.observations import IMAGES, observation_of_run
from thalweg.train.river import RiverTraining
from thalweg.train.rollouts import images as images_of_rollouts
from thalweg.train.rollouts.env_stepper import EnvStepper

SMALL: dict[str, Any] = {
    "policy": "cnn",
    "filters": (4, 8),
    "features": 16,
    "hidden": (16,),
    "steps_per_update": 128,
    "minibatch": 32,
    "passes": 3,
}
GRU: dict[str, Any] = {"memory": "gru", "memory_size": 8, "sequence": 4}


def small(algorithm: str) -> dict[str, Any]:
    natural = {"curvature_steps": 64} if algorithm in ("CPO", "OnCRPO") else {}
    return SMALL | natural


def train(folder: Path, algorithm: str = "PPO", env: BrightSide | None = None, **given: Any):
    usual: dict[str, Any] = {"steps": 512, "seed": 1, "config": small(algorithm), "checkpoint_seconds": 0.0}
    return run(algorithm, env or BrightSide(), folder=folder, **(usual | given))


def share_right(policy: Any, recall: bool) -> float:
    """Share of right options over four episodes in each of 64 environments."""
    env = BrightSide(64, recall)
    obs, _ = env.reset(seed=9)
    player, fresh, right = policy.player(64, deterministic=True), np.ones(64, bool), []
    for _ in range(16):
        obs, reward, _, truncated, _ = env.step(player(obs, fresh))
        right.append(reward)
        fresh = truncated
    return float(np.mean(right))


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["PPO", "CPO"])
def test_the_bright_side_is_found(algorithm: str, tmp_path: Path):
    settings = {"learning_rate": 3e-3} if algorithm == "PPO" else {}
    found = train(tmp_path, algorithm, steps=6144, config=small(algorithm) | settings)
    assert share_right(found.policy, recall=False) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("memory", "expected"), [({}, 0.625), (GRU, 1.0)], ids=["none", "gru"])
def test_with_a_memory_a_side_that_was_bright_is_remembered(memory: dict[str, Any], expected: float, tmp_path: Path):
    """Without one, the first of four steps can be right, and of the last action the others know nothing for sure."""
    config = SMALL | {"learning_rate": 5e-3, "critic_learning_rate": 5e-3, "entropy": 0.0, "passes": 6} | memory
    found = train(tmp_path, env=BrightSide(16, recall=True), steps=16384, config=config | {"steps_per_update": 512})
    assert share_right(found.policy, recall=True) >= expected


@pytest.mark.parametrize("memory", [{}, GRU], ids=["none", "gru"])
@pytest.mark.parametrize("algorithm", ON_POLICY)
def test_a_run_resumes_to_the_bit(algorithm: str, memory: dict[str, Any], tmp_path: Path):
    config = small(algorithm) | memory
    train(tmp_path / "whole", algorithm, config=config)
    with pytest.raises(Stop):
        train(tmp_path / "cut", algorithm, StopsAt(42), config=config)
    assert train(tmp_path / "cut", algorithm, config=config).resumed_from == 256
    assert numbers(tmp_path / "whole") == numbers(tmp_path / "cut")


def test_rows_of_images_are_kept_as_bytes_and_the_run_says_what_they_are(tmp_path: Path):
    found = train(tmp_path)
    said = yaml.safe_load((tmp_path / "config.yaml").read_text())["run"]
    assert said["image"] == [SIZE, SIZE, 1] and said["obs_size"] == SIZE * SIZE + 2 and said["critic_size"] == 2
    assert found.policy.shape.eyes.image == (SIZE, SIZE, 1) and found.policy.normaliser.enabled is False


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_a_row_has_the_options_taken_before_it_in_its_episode(mode: AutoresetMode):
    """Options are counted from 1 here, and from 0 in the environment's second branch; 0 stands for none."""
    stepper = EnvStepper(SyncVectorEnv([OneBrightSide] * 2, autoreset_mode=mode), critics=True, images=True)
    rows, seen = stepper.reset(0), []
    assert rows.dtype == np.uint8 and rows.shape == (2, SIZE * SIZE + 2)
    for number in range(5):
        actions = np.array([[1 + number % 3, 1], [3, number % 2]])
        step = stepper.step(actions)
        expected = np.where(step.fresh[:, None], 0, actions - [1, 0] + 1)
        assert np.array_equal(step.next_obs[:, -2:], expected)
        for env, final in zip(step.finished, step.final_obs, strict=True):
            assert final[-2:].tolist() == (actions[env] - [1, 0] + 1).tolist() and final[0] % 10 == 3
        seen.append(int(step.next_obs[0, 0]))
    same = mode is not AutoresetMode.NEXT_STEP
    assert seen == ([1, 2, 10, 11, 12] if same else [1, 2, 3, 10, 11])


@pytest.mark.parametrize(
    ("config", "env", "error", "words"),
    [
        ({}, Walk(4), TrainingError, r"policy=cnn takes images uint8 \[H, W, C\] as observations, not Box"),
        (
            {"policy": "mlp"},
            BrightSide(),
            TrainingError,
            "wrap environments of images in LatentVectorEnv, or use policy",
        ),
        (
            {"frame_stack": 2},
            BrightSide(),
            AlgorithmError,
            "frame_stack must be 1 with policy=cnn, got 2: use memory=gru",
        ),
        ({"imitation_kl": 1.0}, BrightSide(), AlgorithmError, "imitation_kl = 1.0 weighs the KL .*: give begin_with"),
    ],
)
def test_what_does_not_go_together_is_refused(config: dict, env: Any, error: type, words: str, tmp_path: Path):
    with pytest.raises(error, match=words):
        train(tmp_path / "run", env=env, config=SMALL | config)
    assert not (tmp_path / "run").exists()


def test_critics_that_would_see_nothing_are_refused(tmp_path: Path):
    class Silent(BrightSide):
        def __init__(self) -> None:
            super().__init__()
            del self.single_critic_space

        def told(self) -> Any:
            return None

    with pytest.raises((AlgorithmError, TrainingError), match="single_critic_space"):
        train(tmp_path / "run", env=Silent())


def test_options_are_needed(tmp_path: Path):
    env = BrightSide()
    env.single_action_space = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)  # pyright: ignore
    with pytest.raises(AlgorithmError, match="policy=cnn remembers the options that it took: it has none in Box"):
        train(tmp_path / "run", env=env)


def test_a_byte_must_hold_the_number_of_an_option(tmp_path: Path):
    env = BrightSide()
    env.single_action_space = gym.spaces.MultiDiscrete([3, 256])  # pyright: ignore
    with pytest.raises(AlgorithmError, match="policy=cnn remembers options of at most 255 a branch, not 256"):
        train(tmp_path / "run", env=env)


@pytest.mark.parametrize("algorithm", [name for name in ALGORITHMS if name not in ON_POLICY])
def test_other_algorithms_see_no_images(algorithm: str):
    with pytest.raises(AlgorithmError, match=f"policy is a setting of on-policy algorithms; {algorithm} sees numbers"):
        ALGORITHMS[algorithm].configure({"policy": "cnn"})


def test_a_gpu_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    from thalweg.train.rollouts.tensor_collector import make_collector

    with pytest.raises(DeviceError, match="policy=cnn learns on the CPU only, not on meta"):
        make_collector(BrightSide(), 1, torch.device("meta"), 1, True, True)


def test_a_rollout_that_does_not_fit_the_memory_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """17 states of 8 environments, 66 bytes each, three times."""
    monkeypatch.setattr(images_of_rollouts, "free_bytes", lambda: 3 * 17 * 8 * 66 - 1)
    with pytest.raises(TrainingError, match=r"rollouts of 128 steps .* set steps_per_update to at most 127"):
        train(tmp_path / "run")
    assert not (tmp_path / "run").exists()
    monkeypatch.setattr(images_of_rollouts, "free_bytes", lambda: 3 * 17 * 8 * 66)
    train(tmp_path / "run", steps=128)


def test_defaults_follow_images_but_not_what_is_given():
    plain, cnn = (ALGORITHMS["PPO"].configure({"policy": policy}) for policy in ("mlp", "cnn"))
    assert (plain.passes, plain.learning_rate) == (10, 1e-3) and (cnn.passes, cnn.learning_rate) == (4, 3e-4)
    assert ALGORITHMS["PPO"].configure({"policy": "cnn", "passes": 7}).passes == 7
    assert ALGORITHMS["CPO"].configure({"policy": "cnn"}).curvature_steps == 256
    assert ALGORITHMS["CPO"].configure().curvature_steps == 0


ENCODER: Any = object()


@pytest.mark.parametrize(
    ("images", "encoder", "chosen", "begun", "expected"),
    [
        (False, None, None, None, "privileged"),
        (False, ENCODER, None, None, "frames"),
        (True, None, None, None, "rgb+mask"),
        (True, None, None, image_policy("mask"), "mask"),
        (True, None, "rgb", image_policy("mask"), "rgb"),
        *[(True, None, channels, None, channels) for channels in IMAGES],
    ],
)
def test_what_a_run_sees(images: bool, encoder: Any, chosen: str | None, begun: Any, expected: str):
    assert observation_of_run(images, encoder, chosen, begun) == expected


@pytest.mark.parametrize(
    ("images", "encoder", "chosen", "words"),
    [
        (True, ENCODER, None, "policy=cnn sees images itself: leave the encoder out, or use policy=mlp"),
        (True, None, "privileged", r"policy=cnn sees images, rgb\+mask or rgb or mask, not the privileged observation"),
        (False, None, "rgb", "the observation rgb is for policies with convolutions: set policy=cnn"),
        (False, ENCODER, "privileged", "privileged was asked for, but there is frames through an encoder"),
    ],
)
def test_an_observation_that_does_not_fit_is_refused(images: bool, encoder: Any, chosen: str | None, words: str):
    with pytest.raises(TrainingError, match=words):
        observation_of_run(images, encoder, chosen)


@pytest.mark.parametrize(
    ("begun", "words"),
    [
        (image_policy("rgb"), r"trained on images \(rgb\), but here it would see images \(rgb\+mask\)"),
        (None, r"trained on frames through an encoder, but here it would see images \(rgb\+mask\)"),
    ],
)
def test_no_run_on_images_begins_with_a_policy_of_others(
    begun: Any, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from tests.train.test_image_policies import of_numbers

    (begun or of_numbers(16, {"encoder": "ab"})).save(tmp_path / "other.safetensors")
    monkeypatch.setattr(RiverTraining, "_envs", None)  # refused before there is anything to fly in
    options: dict[str, Any] = {"steps": 64, "seed": 0, "folder": tmp_path / "run", "observation": "rgb+mask"}
    with pytest.raises(TrainingError, match=words):
        RiverTraining("Easy", 2).train(
            "PPO", None, settings={"policy": "cnn"}, begin_with=tmp_path / "other.safetensors", **options
        )
    assert not (tmp_path / "run").exists()


def test_losses_are_logged(tmp_path: Path):
    train(tmp_path, "FOCOPS")
    rows = rows_of(tmp_path, "metrics.csv")
    assert len(rows) == 4 and all(float(row["value_loss"]) >= 0 for row in rows) and "imitation_kl" not in rows[0]
