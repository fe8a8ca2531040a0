"""Tests of imagined rollouts against a loop over single rollouts, and of batches against single environments."""

import pytest
import torch

from tests.algos.planning.planning_fixtures import BOX, OPTIONS, ensemble_for, generator, raw_actions
from thalweg.algos.planning.imagined_rollouts import (
    ImaginedSteps,
    PlanOutcomes,
    evaluate_rollouts,
    imagine_rollouts,
    rollout_policy,
    sample_noise,
)
from thalweg.algos.planning.model.ensemble import Ensemble, FrozenEnsemble, action_features

N, S, P, H = 3, 4, 2, 5


def rollout_inputs(ensemble: Ensemble, *, shared: bool = False) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Start [N, K * D], features [H, N, S, F] and noise [H, M, N, S or 1, P, D]."""
    size = ensemble.frames * ensemble.layout.frame
    start = torch.randn(N, size, generator=generator(1))
    features = action_features(ensemble.actions, raw_actions(ensemble.actions, H, N, S, seed=2))
    return start, features, sample_noise(FrozenEnsemble(ensemble), N, S, P, H, shared, generator(3))


def single_rollout(
    frozen: FrozenEnsemble, start: torch.Tensor, features: torch.Tensor, noise: torch.Tensor, member: int
) -> tuple[list, torch.Tensor]:
    """Predictions of each step and last observation of one particle in one model, without batching."""
    mean, reward, raw, cost, end = frozen.layout.slices
    obs, heads, size = start.clone(), [], frozen.layout.frame
    for step in range(len(features)):
        x = torch.cat([obs, features[step]]).expand(frozen.members, 1, -1).contiguous()
        out = frozen.dense(x)[member, 0]
        heads.append((float(out[reward]), float(out[end].sigmoid()), frozen.cost_range * out[cost].sigmoid()))
        std = (frozen.min_variance + frozen.variance_scale * out[raw].sigmoid()).sqrt()
        newest = (obs[-size:] + out[mean] + std * noise[step]).clamp(-5, 5)
        obs = torch.cat([obs[size:], newest])
    return heads, obs


@pytest.mark.parametrize("frames", [1, 3])
@pytest.mark.parametrize("space", [OPTIONS, BOX], ids=["options", "numbers"])
def test_batched_rollouts_equal_single_rollouts(frames, space):
    ensemble = ensemble_for(space, frames=frames, costs=2)
    frozen, (start, features, noise) = FrozenEnsemble(ensemble), rollout_inputs(ensemble)
    steps = imagine_rollouts(frozen, start, features, noise)
    for member, env, sample, particle in [(0, 0, 0, 0), (3, 2, 1, 1), (2, 1, 3, 0), (1, 2, 3, 1)]:
        heads, last = single_rollout(
            frozen, start[env], features[:, env, sample], noise[:, member, env, sample, particle], member
        )
        index = (member, env, sample, particle)
        for step, (reward, end, costs) in enumerate(heads):
            assert float(steps.rewards[step][index]) == pytest.approx(reward, abs=1e-4)
            assert float(steps.ends[step][index]) == pytest.approx(end, abs=1e-4)
            assert steps.costs[step][index].tolist() == pytest.approx(costs.tolist(), abs=1e-4)
        assert torch.allclose(steps.last_obs[index], last, atol=1e-4)


def test_environments_do_not_affect_one_another():
    ensemble = ensemble_for()
    frozen, (start, features, noise) = FrozenEnsemble(ensemble), rollout_inputs(ensemble)
    together = evaluate_rollouts(imagine_rollouts(frozen, start, features, noise), 0.9, "mean")
    for env in range(N):
        one = slice(env, env + 1)
        alone = evaluate_rollouts(imagine_rollouts(frozen, start[one], features[:, one], noise[:, :, one]), 0.9, "mean")
        assert torch.allclose(alone.returns[0], together.returns[env], atol=1e-5)
        assert torch.allclose(alone.costs[0], together.costs[env], atol=1e-6)


def test_equal_candidates_have_equal_outcomes_only_with_shared_noise():
    ensemble = ensemble_for()
    start, features, _ = rollout_inputs(ensemble)
    features[:, :, 1] = features[:, :, 0]
    for shared in (True, False):
        noise = sample_noise(FrozenEnsemble(ensemble), N, S, P, H, shared, generator(3))
        outcomes = evaluate_rollouts(imagine_rollouts(FrozenEnsemble(ensemble), start, features, noise), 1.0, "mean")
        assert torch.allclose(outcomes.returns[:, 0], outcomes.returns[:, 1], atol=1e-6) is shared


def evaluate_in_loops(steps: ImaginedSteps, discount: float, final: torch.Tensor, maximum: bool) -> PlanOutcomes:
    """Reference of `evaluate_rollouts` in plain loops."""
    returns, rewards, costs = torch.zeros(N, S), torch.zeros(N, S), torch.zeros(N, S, 1)
    members = steps.rewards.shape[1]
    for env in range(N):
        for sample in range(S):
            step_costs: list[list[float]] = [[] for _ in range(H)]
            for member in range(members):
                for particle in range(P):
                    index, alive, total = (member, env, sample, particle), 1.0, 0.0
                    for step in range(H):
                        total += discount**step * alive * float(steps.rewards[step][index])
                        step_costs[step].append(alive * float(steps.costs[step][index]))
                        alive *= 1 - float(steps.ends[step][index])
                    rewards[env, sample] += total / (members * P)
                    returns[env, sample] += (total + discount**H * alive * float(final[index])) / (members * P)
            costs[env, sample, 0] = sum(max(step) if maximum else sum(step) / len(step) for step in step_costs)
    return PlanOutcomes(returns, rewards, costs)


@pytest.mark.parametrize("cost_over", ["mean", "max"])
def test_evaluation_equals_plain_loops(cost_over):
    ensemble = ensemble_for()
    steps = imagine_rollouts(FrozenEnsemble(ensemble), *rollout_inputs(ensemble))
    value = lambda obs, _: obs.sum(-1)  # noqa: E731
    found = evaluate_rollouts(steps, 0.9, cost_over, value=value, last_actions=torch.zeros(N, S, 2))
    expected = evaluate_in_loops(steps, 0.9, steps.last_obs.sum(-1), cost_over == "max")
    assert torch.allclose(found.returns, expected.returns, atol=1e-4)
    assert torch.allclose(found.rewards, expected.rewards, atol=1e-4)
    assert torch.allclose(found.costs, expected.costs, atol=1e-5)


def test_without_terminations_all_costs_count():
    ensemble = ensemble_for()
    steps = imagine_rollouts(FrozenEnsemble(ensemble), *rollout_inputs(ensemble))
    found = evaluate_rollouts(steps, 1.0, "mean", ends=False)
    assert torch.allclose(found.costs[..., 0], steps.costs[..., 0].mean((1, 4)).sum(0), atol=1e-6)


def test_terminal_value_receives_the_last_action_of_each_plan():
    ensemble = ensemble_for()
    steps = imagine_rollouts(FrozenEnsemble(ensemble), *rollout_inputs(ensemble))
    last = torch.arange(N * S).view(N, S, 1)
    marked = evaluate_rollouts(steps, 1.0, "mean", ends=False, value=lambda _, a: a[:, 0].float(), last_actions=last)
    assert torch.allclose(marked.returns - marked.rewards, last.squeeze(-1).float(), atol=1e-4)


def test_policy_rollouts_contain_the_actions_of_the_policy():
    ensemble = ensemble_for(BOX)
    frozen, start = FrozenEnsemble(ensemble), torch.randn(N, 3, generator=generator(1))
    plans = rollout_policy(frozen, start, ensemble.actions, lambda obs: obs[:, :2].tanh(), 2, H, generator(8))
    assert plans.shape == (N, frozen.members * 2, H, 2)
    assert torch.allclose(plans[:, :, 0], start[:, None, :2].tanh().expand(-1, 8, -1), atol=1e-6)
    noise = sample_noise(frozen, N, 2, 1, H, False, generator(8))
    for member, env, copy in [(0, 0, 0), (3, 2, 1), (1, 1, 1)]:
        plan = plans[env, member * 2 + copy]
        for step in range(1, H):
            _, obs = single_rollout(frozen, start[env], plan[:step], noise[:, member, env, copy, 0], member)
            assert torch.allclose(plan[step], obs[:2].tanh(), atol=1e-4)
