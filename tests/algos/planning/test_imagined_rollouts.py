"""Imagined futures against a walk through them one by one, and environments together against each alone."""

import pytest
import torch

from tests.algos.planning.made import BOX, OPTIONS, ensemble_for, generator, raw_actions
from thalweg.algos.planning.imagined_rollouts import (
    Futures,
    Steps,
    evaluate_rollouts,
    imagine_rollouts,
    rollout_policy,
    sample_noise,
)
from thalweg.algos.planning.model.ensemble import Ensemble, FrozenEnsemble, action_features

N, S, P, H = 3, 4, 2, 5


def given(ensemble: Ensemble, *, shared: bool = False) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Start [N, K * D], features [H, N, S, F] and noise."""
    size = ensemble.frames * ensemble.layout.frame
    start = torch.randn(N, size, generator=generator(1))
    features = action_features(ensemble.actions, raw_actions(ensemble.actions, H, N, S, seed=2))
    return start, features, sample_noise(FrozenEnsemble(ensemble), N, S, P, H, shared, generator(3))


def one_future(
    frozen: FrozenEnsemble, start: torch.Tensor, features: torch.Tensor, noise: torch.Tensor, member: int
) -> tuple[list, torch.Tensor]:
    """Heads of each step and the last observation of one particle in one model: nothing shared, nothing batched."""
    mean, reward, raw, cost, end = frozen.layout.parts
    seen, heads, size = start.clone(), [], frozen.layout.frame
    for step in range(len(features)):
        x = torch.cat([seen, features[step]]).expand(frozen.members, 1, -1).contiguous()
        out = frozen.dense(x)[member, 0]
        heads.append((float(out[reward]), float(out[end].sigmoid()), frozen.cost_range * out[cost].sigmoid()))
        std = (frozen.least + frozen.most * out[raw].sigmoid()).sqrt()
        newest = (seen[-size:] + out[mean] + std * noise[step]).clamp(-5, 5)
        seen = torch.cat([seen[size:], newest])
    return heads, seen


@pytest.mark.parametrize("frames", [1, 3])
@pytest.mark.parametrize("space", [OPTIONS, BOX], ids=["options", "numbers"])
def test_sharing_the_first_step_and_the_batch_change_nothing(frames, space):
    ensemble = ensemble_for(space, frames=frames, costs=2)
    frozen, (start, features, noise) = FrozenEnsemble(ensemble), given(ensemble)
    steps = imagine_rollouts(frozen, start, features, noise)
    for member, env, sample, particle in [(0, 0, 0, 0), (3, 2, 1, 1), (2, 1, 3, 0), (1, 2, 3, 1)]:
        heads, last = one_future(
            frozen, start[env], features[:, env, sample], noise[:, member, env, sample, particle], member
        )
        place = (member, env, sample, particle)
        for step, (reward, end, costs) in enumerate(heads):
            assert float(steps.rewards[step][place]) == pytest.approx(reward, abs=1e-4)
            assert float(steps.ends[step][place]) == pytest.approx(end, abs=1e-4)
            assert steps.costs[step][place].tolist() == pytest.approx(costs.tolist(), abs=1e-4)
        assert torch.allclose(steps.last[place], last, atol=1e-4)


def test_environments_together_are_each_alone():
    ensemble = ensemble_for()
    frozen, (start, features, noise) = FrozenEnsemble(ensemble), given(ensemble)
    together = evaluate_rollouts(imagine_rollouts(frozen, start, features, noise), 0.9, "mean")
    for env in range(N):
        one = slice(env, env + 1)
        alone = evaluate_rollouts(imagine_rollouts(frozen, start[one], features[:, one], noise[:, :, one]), 0.9, "mean")
        assert torch.allclose(alone.returns[0], together.returns[env], atol=1e-5)
        assert torch.allclose(alone.costs[0], together.costs[env], atol=1e-6)


def test_with_shared_noise_equal_candidates_have_equal_futures():
    ensemble = ensemble_for()
    start, features, _ = given(ensemble)
    features[:, :, 1] = features[:, :, 0]
    for shared in (True, False):
        noise = sample_noise(FrozenEnsemble(ensemble), N, S, P, H, shared, generator(3))
        futures = evaluate_rollouts(imagine_rollouts(FrozenEnsemble(ensemble), start, features, noise), 1.0, "mean")
        assert torch.allclose(futures.returns[:, 0], futures.returns[:, 1], atol=1e-6) is shared


def by_loops(steps: Steps, discount: float, final: torch.Tensor, worst: bool) -> Futures:
    """The same worth as `evaluate_rollouts`, number by number."""
    returns, rewards, costs = torch.zeros(N, S), torch.zeros(N, S), torch.zeros(N, S, 1)
    members = steps.rewards.shape[1]
    for env in range(N):
        for sample in range(S):
            paid: list[list[float]] = [[] for _ in range(H)]
            for member in range(members):
                for particle in range(P):
                    place, alive, total = (member, env, sample, particle), 1.0, 0.0
                    for step in range(H):
                        total += discount**step * alive * float(steps.rewards[step][place])
                        paid[step].append(alive * float(steps.costs[step][place]))
                        alive *= 1 - float(steps.ends[step][place])
                    rewards[env, sample] += total / (members * P)
                    returns[env, sample] += (total + discount**H * alive * float(final[place])) / (members * P)
            costs[env, sample, 0] = sum(max(step) if worst else sum(step) / len(step) for step in paid)
    return Futures(returns, rewards, costs)


@pytest.mark.parametrize("over", ["mean", "max"])
def test_futures_are_judged_as_loops_over_everything_judge_them(over):
    ensemble = ensemble_for()
    steps = imagine_rollouts(FrozenEnsemble(ensemble), *given(ensemble))
    value = lambda obs, _: obs.sum(-1)  # noqa: E731
    found = evaluate_rollouts(steps, 0.9, over, value=value, last_actions=torch.zeros(N, S, 2))
    wanted = by_loops(steps, 0.9, steps.last.sum(-1), over == "max")
    assert torch.allclose(found.returns, wanted.returns, atol=1e-4)
    assert torch.allclose(found.rewards, wanted.rewards, atol=1e-4)
    assert torch.allclose(found.costs, wanted.costs, atol=1e-5)


def test_without_ends_nothing_is_masked():
    ensemble = ensemble_for()
    steps = imagine_rollouts(FrozenEnsemble(ensemble), *given(ensemble))
    found = evaluate_rollouts(steps, 1.0, "mean", ends=False)
    assert torch.allclose(found.costs[..., 0], steps.costs[..., 0].mean((1, 4)).sum(0), atol=1e-6)


def test_what_is_still_to_come_is_told_the_last_action_of_each_plan():
    ensemble = ensemble_for()
    steps = imagine_rollouts(FrozenEnsemble(ensemble), *given(ensemble))
    last = torch.arange(N * S).view(N, S, 1)
    marked = evaluate_rollouts(steps, 1.0, "mean", ends=False, value=lambda _, a: a[:, 0].float(), last_actions=last)
    assert torch.allclose(marked.returns - marked.rewards, last.squeeze(-1).float(), atol=1e-4)


def test_what_is_rolled_out_in_a_model_is_what_the_actor_would_do_there():
    ensemble = ensemble_for(BOX)
    frozen, start = FrozenEnsemble(ensemble), torch.randn(N, 3, generator=generator(1))
    taken = rollout_policy(frozen, start, ensemble.actions, lambda obs: obs[:, :2].tanh(), 2, H, generator(8))
    assert taken.shape == (N, frozen.members * 2, H, 2)
    assert torch.allclose(taken[:, :, 0], start[:, None, :2].tanh().expand(-1, 8, -1), atol=1e-6)
    noise = sample_noise(frozen, N, 2, 1, H, False, generator(8))
    for member, env, copy in [(0, 0, 0), (3, 2, 1), (1, 1, 1)]:
        plan = taken[env, member * 2 + copy]
        for step in range(1, H):
            _, seen = one_future(frozen, start[env], plan[:step], noise[:, member, env, copy, 0], member)
            assert torch.allclose(plan[step], seen[:2].tanh(), atol=1e-4)
