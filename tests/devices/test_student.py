"""Tests that a student learns on a device as on the CPU, also by recorded steps, and keeps its tensors there."""

import dataclasses

import numpy as np
import pytest
import torch

from tests.algos.imitation.test_student import lesson, small, student  # noqa: F401  (a fixture)
from tests.devices.pretend import PRETEND, Device, pretended
from thalweg.algos.common.cuda_graphs import WARM, CudaGraphs
from thalweg.algos.imitation.student import Lesson, Student
from thalweg.algos.policy import fast_path

pytestmark = pytest.mark.usefixtures("small")


def taught(learner: Student, rounds: int = 3) -> list[dict[str, float]]:
    losses = []
    for seed in range(rounds):
        one = lesson(seed)
        learner.update_scale(one.privileged.flatten(0, 1))
        learner.decay(seed / rounds)
        losses.append(learner.learn(one))
    return losses


def test_learning_on_a_device_equals_learning_on_the_cpu(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(fast_path, "enabled", lambda: False)
    here = student()
    begun, one, every = here.state(), lesson(9), torch.arange(8)
    before, losses = here.losses(one, every), taught(here)
    with pretended(monkeypatch):
        away = student(device=PRETEND)
        away.load_state(begun)  # a layout of memory that the pretended device lacks has other random weights
        lain = Lesson(**{field.name: getattr(one, field.name).to(PRETEND) for field in dataclasses.fields(one)})
        assert away.losses(lain, every.to(PRETEND)).cpu().tolist() == pytest.approx(before.tolist(), rel=1e-5)
        found = taught(away)
        assert {tensor.device for tensor in away.policy.actor.parameters()} == {PRETEND}
    for one, other in zip(found, losses, strict=True):
        assert one == pytest.approx(other, rel=1e-2)  # Adam makes steps of one size from the smallest gradients


def test_recorded_steps_equal_individual_ones(recorder: Device):
    plain, recorded = student(device=PRETEND), student(device=PRETEND)
    recorded._graphs = CudaGraphs(True, [])
    assert 3 * lesson(0).fresh.shape[1] // plain.config.sequences_per_batch > WARM
    assert taught(recorded) == taught(plain)


def test_a_student_of_a_device_resumes(recorder: Device):
    whole, begun, resumed = (student(device=PRETEND) for _ in range(3))
    taught(whole)
    expected = taught(whole)
    taught(begun)
    resumed.load_state(begun.state())
    assert taught(resumed) == expected
    assert resumed.generator.device == begun.generator.device


def test_the_policy_of_a_device_acts_the_same_on_the_cpu(recorder: Device, tmp_path):
    learner = student(device=PRETEND)
    taught(learner)
    learner.policy.save(tmp_path / "policy.safetensors")
    from thalweg.train import load_policy

    loaded = load_policy(tmp_path / "policy.safetensors")
    images = np.random.default_rng(0).integers(0, 256, (3, 8, 8, 1), np.uint8)
    here, away = (policy.player(3)(images, np.ones(3, bool)) for policy in (loaded, learner.policy))
    assert np.array_equal(here, away)
    assert loaded.device == torch.device("cpu")
