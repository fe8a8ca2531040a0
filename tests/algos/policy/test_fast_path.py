"""The fast path computes the gradients and updates of autograd, for every on-policy algorithm."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from tests.algos.onpolicy.test_learners import ON_POLICY, SPACES, learner_for, rollout_of
from tests.algos.rollouts import feedback
from thalweg.algos import AlgorithmError
from thalweg.algos.common.adam import Adam
from thalweg.algos.policy import fast_path

SETTINGS: dict[str, dict[str, Any]] = {
    "default": {},
    "wide": {"hidden": (160,)},
    "relu": {"initial": "kaiming", "activation": "relu", "critic_decay": 1e-2},
    "gru": {"memory": "gru", "memory_size": 8, "sequence": 5},
}
"""Settings that choose different code on the fast path."""
BROKEN = feedback(0.5, largest=2.0)


def update(name: str, space: gym.Space, on: bool, **settings: Any) -> tuple[list[np.ndarray], dict, list[np.ndarray]]:
    """Return all gradients, the metrics and the final parameters of two updates, with the fast path on or off."""
    gradients: list[np.ndarray] = []
    step = Adam.step

    def recording(self: Adam, max_norm: float = float("inf")) -> None:
        gradients.extend(p.grad.detach().numpy().copy() for p in self.parameters if p.grad is not None)
        step(self, max_norm)

    with fast_path.switched(on), pytest.MonkeyPatch.context() as patch:
        learner = learner_for(name, space, **settings)
        patch.setattr(Adam, "step", recording)
        metrics = [learner.update(rollout_of(learner, seed), BROKEN) for seed in (0, 1)]
    modules = learner.policy.actor, learner.agent.critics
    return gradients, metrics[-1], [p.detach().numpy() for module in modules for p in module.parameters()]


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=list(SETTINGS))
@pytest.mark.parametrize("space", [SPACES["MultiDiscrete"], SPACES["Box"]], ids=["MultiDiscrete", "Box"])
@pytest.mark.parametrize("name", ON_POLICY)
def test_updates_are_those_of_autograd(name: str, space: gym.Space, settings: dict[str, Any]):
    usual = {"hidden": (16, 16)} | settings
    (_, fast, ours), (_, slow, theirs) = (update(name, space, on, **usual) for on in (True, False))
    assert fast == pytest.approx(slow, rel=2e-3, abs=2e-4, nan_ok=True)
    for one, other in zip(ours, theirs, strict=True):
        assert one == pytest.approx(other, abs=1e-3)


@pytest.mark.parametrize("name", ON_POLICY)
def test_updates_change_what_the_comparison_looks_at(name: str):
    """The tolerances above are far below the change of an update."""
    learner = learner_for(name, SPACES["MultiDiscrete"])
    before = [p.detach().numpy().copy() for p in learner.agent.critics.parameters()]
    _, _, after = update(name, SPACES["MultiDiscrete"], True)
    assert max(np.abs(one - other).max() for one, other in zip(before, after[-len(before) :], strict=True)) > 1e-2


@pytest.mark.parametrize("name", ON_POLICY)
@pytest.mark.parametrize("memory", ["none", "gru"])
def test_the_first_gradients_are_those_of_autograd(name: str, memory: str):
    """With a wide network the critics are stepped by `Adam.step` on both paths, so that all gradients are seen."""
    settings = {"hidden": (160,), "memory": memory, "memory_size": 8}
    (fast, _, _), (slow, _, _) = (update(name, SPACES["MultiDiscrete"], on, **settings) for on in (True, False))
    assert len(fast) == len(slow) > 0
    for ours, theirs in zip(fast[:8], slow[:8], strict=True):
        assert ours == pytest.approx(theirs, rel=1e-3, abs=1e-5)


def test_both_paths_are_really_taken(monkeypatch: pytest.MonkeyPatch):
    """Off, nothing of the fast path is called."""
    from thalweg.algos.policy import mlp_autograd, mlp_numba, networks

    def refuse(*args: Any, **kwargs: Any) -> None:
        raise AssertionError("the fast path was taken")

    monkeypatch.setattr(mlp_numba, "outputs", refuse)
    monkeypatch.setattr(mlp_numba, "fit_epoch", refuse)
    monkeypatch.setattr(mlp_autograd, "gradients", refuse)
    monkeypatch.setattr(networks.Critics, "fit_epoch", refuse)
    update("FOCOPS", SPACES["MultiDiscrete"], False)
    with pytest.raises(AssertionError, match="the fast path was taken"):
        update("FOCOPS", SPACES["MultiDiscrete"], True)


@pytest.mark.parametrize(("value", "on"), [("0", False), ("1", True)])
def test_the_environment_variable_switches(value: str, on: bool, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(fast_path.VARIABLE, value)
    assert fast_path._from_environment() is on


def test_another_value_of_the_environment_variable_is_refused(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(fast_path.VARIABLE, "yes")
    with pytest.raises(AlgorithmError, match="THALWEG_FAST_PATH must be 0 or 1, got 'yes'"):
        fast_path._from_environment()
