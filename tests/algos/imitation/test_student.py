"""The student learns what its teacher wants, in sequences as step by step, and resumes to the bit."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import torch

from thalweg.algos.common.errors import AlgorithmError, NotFiniteError
from thalweg.algos.common.state import CPU
from thalweg.algos.imitation import student as students
from thalweg.algos.imitation.config import ImitationConfig
from thalweg.algos.imitation.student import LOSSES, Lesson, Student
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.networks import NetworkShape
from thalweg.algos.policy.vision import Eyes, rows_of
from thalweg.core.config import parse_config

EYES = Eyes((8, 8, 1), (4, 4), 8)
ACTIONS = actions_of(gym.spaces.MultiDiscrete([3, 3]))
MOVES = np.array([[a, b] for a in range(3) for b in range(3)])
LENGTH, COUNT = 6, 8
GOOD = 4
"""The move that is worth most where the image is bright; elsewhere it is the first."""


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch):
    """Students of images of 8x8 pixels."""

    def shape(config: ImitationConfig) -> NetworkShape:
        return NetworkShape(config.hidden, "relu", "kaiming", config.memory_size, EYES)

    monkeypatch.setattr(ImitationConfig, "shape", property(shape))


def student(device: torch.device = CPU, *, moves: np.ndarray = MOVES, **settings) -> Student:
    config = parse_config(ImitationConfig, {"memory_size": 6, "hidden": (16,), "learning_rate": 0.01, **settings})
    return Student(config, ACTIONS, moves, (2, 4), seed=0, context={"observation": "mask"}, device=device)


def lesson(seed: int = 0, *, delayed: bool = False) -> Lesson:
    """Bright and dark images; with `delayed`, the teacher wants what the image of the step before says."""
    rng = np.random.default_rng(seed)
    bright = rng.random((LENGTH, COUNT)) < 0.5
    images = np.where(bright[..., None, None, None], 220, 30).astype(np.uint8) * np.ones((8, 8, 1), np.uint8)
    rows = np.stack([rows_of(step, np.full((COUNT, 2), -1)) for step in images])
    fresh = np.zeros((LENGTH, COUNT), bool)
    fresh[0] = True
    wanted = np.concatenate([np.zeros((1, COUNT), bool), bright[:-1]]) if delayed else bright
    worths = np.zeros((LENGTH, COUNT, 9), np.float32)
    worths[..., GOOD] = np.where(wanted, 2.0, -1000.0)
    privileged = np.stack([bright * 2.0, bright * 5.0 + 1.0], -1).astype(np.float32)
    maps = np.repeat(bright[..., None], 4, -1).astype(np.uint8)
    tensors = (rows, fresh, np.zeros((COUNT, 6), np.float32), worths, privileged, maps)
    return Lesson(*(torch.from_numpy(array) for array in tensors))


def taught(learner: Student, *, delayed: bool = False, rounds: int = 60) -> dict[str, float]:
    losses = {}
    for seed in range(rounds):
        one = lesson(seed, delayed=delayed)
        learner.update_scale(one.privileged.flatten(0, 1))
        losses = learner.learn(one)
    return losses


def test_it_learns_to_avoid_what_is_fatal_and_to_see(small: None):
    learner = student()
    before = learner.losses(lesson(99), torch.arange(COUNT)).tolist()
    losses = taught(learner)
    assert losses["regret"] < 0.2 < before[1]
    assert losses["privileged_error"] < 0.2 and losses["map_error"] < 0.2
    player = learner.policy.player(2, deterministic=True)
    images = np.stack([np.full((8, 8, 1), value, np.uint8) for value in (220, 30)])
    actions = player(images, np.ones(2, bool))
    assert actions[0].tolist() == MOVES[GOOD].tolist()
    assert actions[1].tolist() != MOVES[GOOD].tolist()


def test_where_either_move_may_be_fatal_it_does_not_flee_to_options_of_no_move(small: None):
    learner, rng = student(moves=MOVES[MOVES[:, 0] < 2]), np.random.default_rng(0)
    for seed in range(60):
        one = lesson(seed)
        fatal = torch.from_numpy(rng.integers(2, size=(LENGTH, COUNT, 1)))
        worths = torch.where(torch.from_numpy(MOVES[: len(learner.moves), 0]) == fatal, -1000.0, 0.0)
        losses = learner.learn(replace(one, worths=worths))
    player = learner.policy.player(1, deterministic=True)
    player(np.full((1, 8, 8, 1), 30, np.uint8), np.ones(1, bool))
    log_probs = player.log_probs()
    assert log_probs is not None and np.exp(log_probs[0, 0]).tolist() == pytest.approx([0.5, 0.5, 0.0], abs=0.3)
    assert log_probs[0, 0, 2] < math.log(0.05)
    assert losses["regret"] == pytest.approx(10.0, abs=2.0)


def test_only_a_memory_can_tell_what_was_seen_before(small: None):
    with_memory = taught(student(), delayed=True, rounds=150)
    without = taught(student(memory_size=0), delayed=True, rounds=150)
    assert with_memory["regret"] < 0.2 < 1.0 < without["regret"]


def test_making_one_leaves_the_global_generator_alone(small: None):
    before = torch.get_rng_state()
    student()
    assert torch.equal(torch.get_rng_state(), before)


def test_it_resumes_to_the_same_numbers(small: None):
    learner, other = student(), student()
    taught(learner, rounds=3)
    other.load_state(learner.state())
    assert learner.learn(lesson(7)) == other.learn(lesson(7))
    assert torch.equal(learner.policy.actor.stack.flat, other.policy.actor.stack.flat)


def test_the_learning_rate_falls(small: None):
    learner = student()
    learner.decay(0.0)
    assert learner.optimiser.rate == pytest.approx(0.01)
    learner.decay(1.0)
    assert learner.optimiser.rate == pytest.approx(0.01 * students.LEAST_RATE)


def test_a_loss_that_is_not_finite_is_named(small: None):
    learner, one = student(), lesson()
    learner.update_scale(one.privileged.flatten(0, 1))
    one.privileged[0, 0, 0] = float("nan")
    with pytest.raises(NotFiniteError, match="privileged_error"):
        learner.learn(one)


def test_auxiliary_losses_can_be_left_out(small: None):
    learner = student(auxiliary_weight=0.0)
    before = learner.map.weight.clone()
    assert set(learner.learn(lesson())) == set(LOSSES)
    assert torch.equal(learner.map.weight, before)


def gradient_of(parameter: torch.Tensor) -> torch.Tensor:
    assert parameter.grad is not None
    return parameter.grad.clone()


@pytest.mark.parametrize("weight", [0.0, 3.0])
def test_a_gradient_is_that_of_the_losses_by_their_weights(weight: float, small: None, monkeypatch: pytest.MonkeyPatch):
    learner, one = student(regret_weight=weight, auxiliary_weight=0.5, sequences_per_batch=COUNT), lesson()
    parameters, found = learner.optimiser.parameters, []
    losses = learner.losses(replace(one, privileged=learner.scale(one.privileged)), torch.arange(COUNT))
    expected = torch.autograd.grad(losses @ torch.tensor([1.0, weight, 0.5, 0.5]), parameters)
    monkeypatch.setattr(learner.optimiser, "step", lambda _: found.extend(map(gradient_of, parameters)))
    learner.learn(one)
    for gradient, wanted in zip(found, expected, strict=True):
        torch.testing.assert_close(gradient, wanted, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"noise": 1.5}, "noise must be"),
        ({"observation": "depth"}, "observation must be"),
        ({"learnign_rate": 1.0}, "did you mean 'learning_rate'|learnign_rate"),
    ],
)
def test_wrong_settings_are_named(settings: dict, message: str):
    with pytest.raises(AlgorithmError, match=message):
        parse_config(ImitationConfig, settings)
