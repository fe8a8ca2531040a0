"""Tests that every learner stays on the device of its task and copies no tensor in a step."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch

from tests.devices.pretend import PRETEND, Device, Mixed, Pretend, pretended
from tests.devices.toy import SPACES, TensorWalk
from thalweg.algos import ALGORITHMS
from thalweg.algos.common.state import CPU, array_of
from thalweg.algos.interface import Task
from thalweg.algos.policy.policy_file import load_policy
from thalweg.train.rollouts.tensor_collector import TensorCollector
from thalweg.train.trainer import Trainer

N, STEPS = 8, 240
SHORT: dict[str, dict[str, Any]] = {
    **{
        name: {"steps_per_update": 80, "minibatch": 40, "passes": 2}
        for name in ("PPO", "PPOLag", "FOCOPS", "P3O", "CUP")
    },
    **{name: {"steps_per_update": 80, "minibatch": 40, "passes": 2} for name in ("OnCRPO", "CPO")},
    **{name: {"random_steps": 40, "steps_per_update": 80, "minibatch": 16} for name in ("DDPGLag", "TD3Lag", "SACLag")},
    **{
        name: {
            "random_steps": 80,
            "steps_per_update": 80,
            "steps_per_collection": 40,
            "minibatch": 16,
            "model_steps": 4,
            "critic_steps": 4,
            "hidden": (8,),
            "model_hidden": (8, 8),
        }
        for name in ("SafeLOOP", "CCEPETS")
    },
}
CASES = [
    *[(name, "MultiDiscrete", {"cost_limits": (0.5, 1.0), "frame_stack": 2}) for name in ALGORITHMS if name != "PPO"],
    *[(name, "Box", {}) for name in ALGORITHMS],
    *[(name, "Discrete", {}) for name in ("PPO", "SACLag", "SafeLOOP")],
    *[(name, "MultiDiscrete", {"adapter": "box_scaled"}) for name in ("FOCOPS", "TD3Lag", "SACLag", "SafeLOOP")],
    *[(name, "MultiDiscrete", {"memory": "gru", "memory_size": 4}) for name in ("FOCOPS", "CPO")],
    ("FOCOPS", "MultiDiscrete", {"hidden": (200,), "activation": "relu", "initial": "kaiming"}),
    ("CCEPETS", "MultiDiscrete", {"fitting": "refit", "refit_steps": 150, "refit_patience": 1, "action_repeat": 2}),
    ("SafeLOOP", "Box", {"settled_variance": 0.1, "precision": "bfloat16"}),
]


@pytest.fixture
def there(monkeypatch: pytest.MonkeyPatch) -> Iterator[Device]:
    with pretended(monkeypatch) as device:
        yield device


def trained(name: str, space: str, settings: dict[str, Any], device: torch.device, steps: int = STEPS) -> Trainer:
    entry = ALGORITHMS[name]
    limit = {} if name == "PPO" or "cost_limits" in settings else {"cost_limit": 0.5}
    config = entry.configure(SHORT[name] | limit | settings)
    env = TensorWalk(N, SPACES[space], device)
    collector = TensorCollector(env, config.frame_stack, 1)
    learner = entry.make(config, Task(collector.obs_size, SPACES[space], N, 0, {}, device))
    trainer = Trainer(collector, learner, steps, seed=0, threads=1)
    trainer.start()
    trainer.metrics = []  # pyright: ignore[reportAttributeAccessIssue]
    while not trainer.done:
        trainer.step()
        if trainer.ready:
            trainer.metrics.append(trainer.update())  # pyright: ignore[reportAttributeAccessIssue]
    return trainer


@pytest.mark.parametrize(("name", "space", "settings"), CASES, ids=lambda each: str(each))
@pytest.mark.slow
def test_a_learner_stays_on_its_device(name: str, space: str, settings: dict[str, Any], there: Device):
    trainer = trained(name, space, settings, PRETEND)
    told = [metrics for metrics in trainer.metrics if metrics]  # pyright: ignore[reportAttributeAccessIssue]
    assert len(told) >= 2 and trainer.statistics.count > 20
    losses = [metric for metric in told[-1] if metric.endswith("loss")]
    assert losses
    for loss in losses:  # NaN where nothing was fitted since the last report
        assert any(np.isfinite(metrics[loss]) for metrics in told), loss


@pytest.mark.parametrize("name", list(ALGORITHMS))
@pytest.mark.slow
def test_training_on_a_device_equals_training_on_the_cpu(name: str, monkeypatch: pytest.MonkeyPatch):
    # The pretended device draws the CPU's random numbers; compiled loops and gradients by hand are the CPU's alone.
    here = dict(floats(trained(name, "MultiDiscrete", {}, CPU).learner.state()))
    with pretended(monkeypatch):
        there = dict(floats(trained(name, "MultiDiscrete", {}, PRETEND).learner.state()))
    assert here.keys() == there.keys() and len(here) > 5
    for part, numbers in here.items():
        np.testing.assert_allclose(there[part], numbers, rtol=1e-3, atol=1e-4, err_msg=part)


def floats(state: Any, part: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """All arrays of floats in nested dictionaries, by their place."""
    if isinstance(state, dict):
        for name, value in state.items():
            yield from floats(value, f"{part}/{name}")
    elif isinstance(state, np.ndarray) and state.dtype.kind == "f":
        yield part, state


@pytest.mark.parametrize("name", list(ALGORITHMS))
@pytest.mark.slow
def test_a_policy_of_a_device_acts_the_same_on_the_cpu(name: str, there: Device, tmp_path):
    trainer = trained(name, "MultiDiscrete", {}, PRETEND)
    trainer.learner.policy.save(tmp_path / "policy.safetensors")
    obs, fresh = np.random.default_rng(0).standard_normal((N, 3)).astype(np.float32), np.ones(N, dtype=bool)
    found = []
    for device in (CPU, PRETEND):
        policy = load_policy(tmp_path / "policy.safetensors", device)
        assert policy.device == device
        found.append(policy.player(N, deterministic=True)(obs, fresh))
    assert np.array_equal(*found)


@pytest.mark.parametrize("name", list(ALGORITHMS))
@pytest.mark.slow
def test_a_checkpoint_of_a_device_has_arrays_and_restores_everything(name: str, there: Device):
    trainer = trained(name, "MultiDiscrete", {}, PRETEND)
    state = trainer.learner.state()
    again = trained(name, "MultiDiscrete", {}, PRETEND, steps=1)
    again.learner.load_state(state)
    same(state, again.learner.state())


def same(one: Any, other: Any) -> None:
    """Nested dictionaries of arrays and plain data."""
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            same(one[key], other[key])
    elif isinstance(one, np.ndarray):
        assert one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    else:
        assert one == other or one != one


@pytest.mark.parametrize("name", list(ALGORITHMS))
@pytest.mark.slow
def test_nothing_is_copied_in_a_step(name: str, there: Device):
    trainer = trained(name, "MultiDiscrete", {}, PRETEND, steps=240)  # past its random steps
    trainer.step()
    trainer.learner.rollout_steps = 10**6  # pyright: ignore[reportAttributeAccessIssue]
    there.copied.clear()
    trainer.collector.step(trainer.learner)
    assert not +there.copied


class TestPretend:
    """The device notices what a GPU would not put up with."""

    def test_tensors_of_two_devices_cannot_be_mixed(self, there: Device):
        held = torch.ones(3, device=PRETEND)
        assert isinstance(held, Pretend) and held.device == PRETEND
        with pytest.raises(Mixed):
            held.add(torch.ones(3))
        assert array_of(held + torch.tensor(2.0)).tolist() == [3.0] * 3

    def test_a_tensor_cannot_be_read_as_an_array(self, there: Device):
        with pytest.raises(Mixed):
            torch.ones(3, device=PRETEND).numpy()
        with pytest.raises(Mixed):
            np.asarray(torch.ones(3, device=PRETEND))

    def test_copies_are_counted(self, there: Device):
        held = torch.arange(3, device=PRETEND)
        assert not +there.copied
        held.cpu()
        assert there.copied["to the host"] == 1
        torch.ones(3).to(PRETEND)
        assert there.copied["to the device"] == 1
        float(held.sum())
        assert there.copied["read"] == 1


def test_views_are_not_counted_as_launches(there: Device):
    tensor = torch.zeros(4, 6, device=PRETEND)
    before = there.launched
    seen = tensor.T[1:].reshape(-1, 2).unsqueeze(0).expand(3, -1, -1)
    assert there.launched == before + 1  # the transposed rows are copied, nothing else
    seen.sum().add_(1.0)
    torch.empty(3, device=PRETEND)
    assert there.launched == before + 3
