"""Agents that see images: gradients, natural steps, what critics see, and the KL from the policy that a run begins
with."""

import dataclasses
from typing import Any

import gymnasium as gym
import pytest
import torch

from tests.algos import rollouts
from tests.algos.onpolicy.test_learners import ON_POLICY
from tests.algos.rollouts import feedback
from thalweg.algos import ALGORITHMS
from thalweg.algos.interface import Rollout, Task
from thalweg.algos.maths import losses
from thalweg.algos.onpolicy.agent import Agent, reward_signal
from thalweg.algos.onpolicy.config import NaturalConfig, settings_like
from thalweg.algos.onpolicy.imitated import Imitated
from thalweg.algos.onpolicy.kl_monitor import KLMonitor
from thalweg.algos.onpolicy.natural_step import NaturalStep, vector_of
from thalweg.algos.onpolicy.rollout_samples import Samples
from thalweg.algos.policy.policy import Policy

N, T, C = 4, 16, 3
IMAGE, SPACE = (8, 8, 2), gym.spaces.MultiDiscrete([3, 2])
D = 8 * 8 * 2 + 2
TASK = Task(D, SPACE, N, 0, {}, image=IMAGE, critic_size=C)
SIGHT: dict[str, Any] = {"policy": "cnn", "filters": (4, 6), "features": 8, "hidden": (6,), "steps_per_update": N * T}
SIGHT |= {"minibatch": 16, "passes": 2, "critic_warmup_steps": 0}
GRU: dict[str, Any] = {"memory": "gru", "memory_size": 5, "sequence": 6}
MEMORIES = pytest.mark.parametrize("memory", [{}, GRU], ids=["none", "gru"])


def rollout(learner: Any, seed: int = 0) -> Rollout:
    """Steps through random images, acted by a learner or an agent, rewarded and priced at random, of which some end."""
    generator = torch.Generator().manual_seed(seed)
    obs = torch.randint(0, 256, (T + 1, N, D), dtype=torch.uint8, generator=generator)
    obs[..., -2:] = torch.randint(0, 3, (T + 1, N, 2), dtype=torch.uint8, generator=generator)
    ends = torch.rand(T, N, generator=generator) < 0.1
    fresh = torch.cat([torch.ones(1, N, dtype=torch.bool), ends])
    actions = torch.stack([learner.act(obs[t], fresh[t]) for t in range(T)])
    return rollouts.rollout_of(
        obs,
        fresh=fresh,
        actions=actions,
        terminated=ends,
        rewards=torch.rand(T, N, generator=generator),
        costs=torch.rand(T, N, 1, generator=generator),
        final_index=ends.flatten().nonzero().squeeze(-1),
        final_obs=obs[1:][ends],
        critic_obs=torch.randn(T + 1, N, C, generator=generator),
        final_critic_obs=torch.randn(int(ends.sum()), C, generator=generator),
    )


def agent(**settings: Any) -> tuple[Agent, Rollout, Samples]:
    """An agent of natural steps away from its uniform start, and what it has flown."""
    made = Agent("any", 1, NaturalConfig(**(SIGHT | settings)), TASK)
    shake(made.policy)
    flown = rollout(made)
    return made, flown, made.samples(flown, [reward_signal(made.config, flown)])


def shake(policy: Policy, by: float = 0.1, seed: int = 1) -> None:
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in policy.actor.parameters():
            parameter += by * torch.randn(parameter.shape, generator=generator)


def learner_for(name: str, begun: bool = True, **settings: Any) -> Any:
    """A learner, whose policy began with another one of its kind."""
    natural = {"curvature_steps": 32} if "curvature_steps" in vars(ALGORITHMS[name].config()) else {}
    made: Any = ALGORITHMS[name].make(ALGORITHMS[name].config(**(SIGHT | natural | settings)), TASK)
    if begun:
        other: Any = ALGORITHMS["PPO"].make(
            ALGORITHMS["PPO"].config(**(SIGHT | GRU if "memory" in settings else SIGHT)), TASK
        )
        shake(other.policy)
        made.policy.initialise_from(other.policy)
    return made


def kl_from_origin(learner: Any, flown: Rollout) -> float:
    """Mean KL(π ‖ π_0) over the steps of a rollout, each policy with its own memory."""
    origin = learner.policy.origin
    new, old = (
        policy.actions.distribution(Imitated(policy, N).parameters(flown)) for policy in (learner.policy, origin)
    )
    return float(new.kl(old).mean())


@MEMORIES
def test_the_gradient_of_a_step_is_that_of_finite_differences(memory: dict[str, Any]):
    made, _, samples = agent(**memory)
    made.policy_optimiser.step = lambda max_norm=0.0: None
    made.policy.actor.double()
    hidden = {name: start.double() for name, start in getattr(samples.inputs, "starts", {}).items()}
    inputs = dataclasses.replace(samples.inputs, starts=hidden) if memory else samples.inputs  # pyright: ignore

    def loss_of(new: Any) -> torch.Tensor:
        return -(new.log_prob(samples.actions) * samples.advantages[0]).mean() - 0.1 * new.entropy().mean()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(torch.Tensor, "float", torch.Tensor.double)  # the images too in double precision
        made.step(inputs, loss_of)
        for parameter in made.policy.actor.parameters():
            place = int(parameter.grad.abs().argmax())  # pyright: ignore[reportOptionalMemberAccess]
            values, flat = [], parameter.detach()
            index = torch.unravel_index(torch.tensor(place), flat.shape)
            for change in (1e-6, -1e-6):
                flat[index] += change
                with torch.no_grad():
                    values.append(float(loss_of(made.policy.distribution_of(inputs))))
                flat[index] -= change
            found = float(parameter.grad[index])  # pyright: ignore[reportOptionalSubscript]
            assert found == pytest.approx((values[0] - values[1]) / 2e-6, rel=1e-4, abs=1e-8)


@MEMORIES
def test_a_natural_gradient_in_parts_is_that_of_the_whole(memory: dict[str, Any]):
    made, _, samples = agent(**memory)
    monitor = KLMonitor(made, samples)
    natural = NaturalStep(made, samples, monitor, made.config)  # pyright: ignore[reportArgumentType]
    new = made.policy.distribution_of(samples.inputs)
    whole = losses.surrogate(new.log_prob(samples.actions), monitor.old_log_prob, samples.advantages[0])
    expected = vector_of(torch.autograd.grad(whole, list(made.policy.actor.parameters())))
    assert len(list(samples.parts(16))) == 4
    assert natural.gradient(samples.advantages[0]) == pytest.approx(expected, abs=1e-6) and expected.norm() > 1e-3


@MEMORIES
def test_the_curvature_is_that_of_the_samples_drawn_for_it(memory: dict[str, Any]):
    """H v by second derivatives, against Jᵀ F J v over the same samples."""
    made, _, samples = agent(curvature_steps=16, damping=0.0, **memory)
    natural = NaturalStep(made, samples, KLMonitor(made, samples), made.config)  # pyright: ignore[reportArgumentType]
    inputs, rows = natural._curved
    assert isinstance(rows, torch.Tensor) and 8 <= len(rows) <= 24 and len(set(rows.tolist())) == len(rows)
    parameters = list(made.policy.actor.parameters())
    outputs = made.policy.actor(inputs, twice_differentiable=True)
    vector = torch.randn(sum(p.numel() for p in parameters), generator=made.generator)
    expected = torch.zeros_like(vector)
    for logits in outputs:
        jacobian = torch.stack([vector_of(torch.autograd.grad(x, parameters, retain_graph=True)) for x in logits])
        parts = [part.softmax(0) for part in logits.detach().split([3, 2])]
        fisher = torch.block_diag(*[p.diag() - torch.outer(p, p) for p in parts])
        expected += jacobian.T @ (fisher @ (jacobian @ vector)) / len(outputs)
    products = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "thalweg.algos.onpolicy.natural_step.conjugate_gradient",
            lambda product, gradient, iterations: products.append(product(vector)),
        )
        natural.solve(vector)
    assert products[0] == pytest.approx(expected, rel=1e-3, abs=1e-5)


@MEMORIES
@pytest.mark.parametrize("name", ["CPO", "OnCRPO"])
def test_a_natural_step_stays_in_its_trust_region(name: str, memory: dict[str, Any]):
    learner = learner_for(name, begun=False, trust_radius=0.01, **memory)
    shake(learner.policy)
    found = [learner.update(rollout(learner, seed), feedback(0.01)) for seed in range(3)]
    assert all(metrics["kl"] <= 0.01 for metrics in found) and max(metrics["kl"] for metrics in found) > 1e-3


@MEMORIES
def test_critics_see_only_what_they_are_told(memory: dict[str, Any]):
    made, flown, samples = agent(**memory)
    assert made.critics.gru is None and isinstance(samples.critic_inputs, torch.Tensor)
    assert samples.critic_inputs.shape == (N * T, C) and made.critics.compiled
    told = flown.critic_obs[:-1].flatten(0, 1)  # pyright: ignore[reportOptionalSubscript]
    expected = ((told - told.mean(0)) / told.std(0, correction=0)).clamp(-5, 5)
    assert torch.allclose(samples.critic_inputs, expected[samples.index], atol=1e-4)
    assert torch.equal(samples.actions, flown.actions.flatten(0, 1)[samples.index])


def test_images_stay_bytes_in_samples():
    _, flown, samples = agent()
    assert isinstance(samples.inputs, torch.Tensor) and samples.inputs.dtype == torch.uint8
    assert torch.equal(samples.inputs, flown.obs[:-1].flatten(0, 1)[samples.index])


@MEMORIES
def test_what_acts_is_what_is_learnt_from(memory: dict[str, Any]):
    """Parameters along a rollout are those of a player that acts, also in the next rollout."""
    learner = learner_for("PPO", begun=False, **memory)
    shake(learner.policy)
    along = Imitated(learner.policy, N)
    player = learner.policy.player(N)
    for seed in (0, 1):
        flown = rollout(learner, seed)
        found = along.parameters(flown).view(T, N, -1)
        for t in range(T):
            before = player.hidden
            player.raw(flown.obs[t], flown.fresh[t])
            if before is None:
                expected = learner.policy.actor(flown.obs[t])
            else:
                expected, _ = learner.policy.actor.step(flown.obs[t], before, flown.fresh[t])
            assert torch.allclose(found[t], expected, atol=1e-5)


def test_the_weight_of_the_kl_falls_linearly_to_zero():
    config = NaturalConfig(imitation_kl=2.0, imitation_kl_share=0.4)
    assert [config.imitation_weight(p) for p in (0.0, 0.1, 0.2, 0.4, 0.9)] == pytest.approx([2.0, 1.5, 1.0, 0.0, 0.0])


@MEMORIES
def test_the_kl_is_to_what_the_first_policy_draws_at_its_temperature(memory: dict[str, Any]):
    learner = learner_for("PPO", **memory)
    origin = learner.policy.origin
    origin.temperature = 0.5
    learner.policy.initialise_from(origin)
    assert kl_from_origin(learner, rollout(learner)) == pytest.approx(0.0, abs=1e-6)
    origin.temperature = 1.0
    assert kl_from_origin(learner, rollout(learner)) > 1e-4


@MEMORIES
@pytest.mark.parametrize("name", ON_POLICY)
def test_the_kl_is_zero_at_first_and_logged(name: str, memory: dict[str, Any]):
    learner = learner_for(name, imitation_kl=1.0, critic_warmup_steps=N * T, **memory)
    learner.warm_up_critics()
    first, flown = learner.update(rollout(learner), feedback(0.5)), rollout(learner, 1)
    assert first["imitation_kl"] == pytest.approx(0.0, abs=1e-6) and first["kl"] == pytest.approx(0.0, abs=1e-6)
    memories = learner.agent.imitated.hidden
    second = learner.update(flown, feedback(0.5))
    if memories is None:
        assert second["imitation_kl"] == pytest.approx(kl_from_origin(learner, flown), rel=1e-3, abs=1e-6)
    assert second["imitation_kl"] > 1e-5


@MEMORIES
@pytest.mark.parametrize("name", ON_POLICY)
def test_a_heavy_kl_holds_the_policy_where_it_began(name: str, memory: dict[str, Any]):
    """With the weight at its height, gone by the time of the rollout, and without any."""
    quick = {"learning_rate": 1e-2, "target_kl": 10.0} if "learning_rate" in vars(ALGORITHMS[name].config()) else {}
    found = {}
    for label, weight, progress in (("held", 300.0, 0.0), ("late", 300.0, 0.5), ("free", 0.0, 0.5)):
        learner = learner_for(name, imitation_kl=weight, **quick, **memory)
        for seed in range(4):
            learner.update(rollout(learner, seed), feedback(0.01, progress=progress))
        found[label] = kl_from_origin(learner, rollout(learner, 9))
    assert found["held"] < 0.2 * found["free"] and found["late"] == pytest.approx(found["free"], rel=1e-4)


@MEMORIES
@pytest.mark.parametrize("name", ["CPO", "OnCRPO"])
def test_a_natural_step_goes_back_to_where_the_run_began(name: str, memory: dict[str, Any]):
    learner = learner_for(name, imitation_kl=1e3, critic_learning_rate=0.0, **memory)
    shake(learner.policy, 0.2, seed=2)
    flown = rollout(learner)
    before = kl_from_origin(learner, flown)
    found = learner.update(flown, feedback(0.01))
    assert found["steps_refused"] < 15 and kl_from_origin(learner, flown) < 0.8 * before


@pytest.mark.parametrize(("change", "accepted"), [(1.0, False), (-1.0, True)])
@pytest.mark.parametrize("name", ["CPO", "OnCRPO"])
def test_a_step_that_leaves_the_imitated_policy_is_not_accepted(
    name: str, change: float, accepted: bool, monkeypatch: pytest.MonkeyPatch
):
    """If nothing else changes: the ratio is 1 in every state."""
    learner, asked = learner_for(name, imitation_kl=1.0), []

    def search(natural: NaturalStep, step: torch.Tensor, accepts: Any) -> int:
        asked.append(accepts(natural._drift.old_log_prob, natural.imitation + change))
        return 0

    monkeypatch.setattr(NaturalStep, "search", search)
    learner.update(rollout(learner), feedback(0.01))
    assert asked == [accepted]


def test_settings_follow_from_the_shape_of_a_policy():
    policy = learner_for("PPO", begun=False, **GRU).policy
    settings = settings_like(policy.shape)
    assert settings == {
        "hidden": (6,), "activation": "tanh", "filters": (4, 6), "features": 8, "memory": "gru", "memory_size": 5
    }  # fmt: skip
    assert ALGORITHMS["CPO"].config(policy="cnn", **settings).shape(IMAGE) == policy.shape
