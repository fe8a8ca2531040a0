"""Imagined rollouts of candidate plans in all models at once, and their returns and costs.

Dimensions: M models, N environments, S candidates, P particles per candidate and model, H steps ahead, K stacked frames
of D numbers, F action features, C costs. Only the steps are a Python loop.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from thalweg.algos.maths import planning
from thalweg.algos.planning.config import CostOver
from thalweg.algos.planning.model.ensemble import FrozenEnsemble, action_features
from thalweg.algos.policy.actions import Actions

Value = Callable[[Tensor, Tensor], Tensor]
"""Terminal value [R] of normalised observations [R, K * D] and the raw actions [R, A] that led to them."""


@dataclass(frozen=True)
class PlanOutcomes:
    """Predicted returns and costs of candidate plans, over all models and particles."""

    returns: Tensor
    """[N, S], mean discounted return, terminal value included."""
    rewards: Tensor
    """[N, S], the part of the return within the horizon."""
    costs: Tensor
    """[N, S, C], within the horizon."""


@dataclass(frozen=True)
class ImaginedSteps:
    """Predictions for every imagined step."""

    rewards: Tensor
    """[H, M, N, S, P]."""
    costs: Tensor
    """[H, M, N, S, P, C]."""
    ends: Tensor
    """[H, M, N, S, P], probability that the episode terminates."""
    last_obs: Tensor
    """[M, N, S, P, K * D], normalised observation after the last step."""


def sample_noise(
    frozen: FrozenEnsemble,
    envs: int,
    samples: int,
    particles: int,
    horizon: int,
    shared: bool,
    generator: torch.Generator,
) -> Tensor:
    """Return standard normal noise [H, M, N, S, P, D], or [H, M, N, 1, P, D] if candidates share it."""
    shape = (horizon, frozen.members, envs, 1 if shared else samples, particles, frozen.layout.frame)
    return torch.randn(shape, dtype=torch.float32, generator=generator, device=generator.device)


def imagine_rollouts(
    frozen: FrozenEnsemble, start: Tensor, features: Tensor, noise: Tensor, *, needs_last: bool = True
) -> ImaginedSteps:
    """Simulate N * S plans in every model.

    Args:
        frozen: Ensemble to simulate with.
        start: Normalised observations [N, K * D].
        features: Features of the planned actions [H, N, S, F], from `action_features`.
        noise: [H, M, N, S or 1, P, D], from `sample_noise`.
        needs_last: Whether `last_obs` is used; without it the last state transition is skipped.

    All particles of a candidate in a model are identical at the first step, so that step is computed for one of them.
    """
    (horizon, envs, samples), layout, members = features.shape[:3], frozen.layout, frozen.members
    particles, obs_size = noise.shape[-2], start.shape[-1]
    mean, reward, raw, cost, _ = layout.slices
    shape = (members, envs, samples, particles)
    outputs = start.new_empty(horizon, *shape, 2 + layout.costs)
    inputs = _inputs(frozen, start, samples, 1)
    for step in range(horizon):
        inputs[..., obs_size:] = features[step].unsqueeze(-2)
        out = frozen.dense(inputs.view(members, -1, frozen.inputs)).view(*inputs.shape[:-1], -1)
        out[..., raw.start :].sigmoid_()
        outputs[step, ..., :1] = out[..., reward]
        outputs[step, ..., 1:] = out[..., cost.start :]
        if step == horizon - 1 and not needs_last:
            break
        if step == 0:
            inputs = _inputs(frozen, start, samples, particles)
        _advance(frozen, inputs[..., :obs_size], out[..., mean], out[..., raw], noise[step])
    costs = frozen.cost_low + frozen.cost_range * outputs[..., 1:-1]
    return ImaginedSteps(outputs[..., 0], costs, outputs[..., -1], inputs[..., :obs_size])


def evaluate_rollouts(
    steps: ImaginedSteps,
    discount: float,
    cost_over: CostOver,
    *,
    ends: bool = True,
    value: Value | None = None,
    last_actions: Tensor | None = None,
) -> PlanOutcomes:
    """Return discounted returns and costs of imagined rollouts.

    Args:
        steps: From `imagine_rollouts`.
        discount: γ.
        cost_over: Whether the cost of a step is the mean or the maximum over models and particles.
        ends: Whether imagined episodes can terminate.
        value: Terminal value after the last step; None counts it as 0.
        last_actions: Raw actions of the last step [N, S, A], passed to `value`.
    """
    alive = planning.survival(steps.ends if ends else torch.zeros_like(steps.ends))
    rewards = planning.imagined_return(steps.rewards, alive, discount)
    returns, shape = rewards, rewards.shape
    if value is not None and last_actions is not None:
        actions = last_actions.unsqueeze(-2).expand(*shape, -1)
        final = value(steps.last_obs.flatten(0, -2), actions.flatten(0, -2)).view(shape)
        returns = planning.imagined_return(steps.rewards, alive, discount, final)
    step_costs = planning.imagined_cost(steps.costs, alive)
    reduced = step_costs.mean((1, 4)) if cost_over == "mean" else step_costs.amax((1, 4))
    return PlanOutcomes(returns.mean((0, 3)), rewards.mean((0, 3)), reduced.sum(0))


def rollout_policy(
    frozen: FrozenEnsemble,
    start: Tensor,
    actions: Actions,
    sample_actions: Callable[[Tensor], Tensor],
    count: int,
    horizon: int,
    generator: torch.Generator,
) -> Tensor:
    """Return raw actions [N, M * count, H, A] that a policy takes in `count` imagined rollouts per model.

    Args:
        frozen: Ensemble to simulate with.
        start: Normalised observations [N, K * D].
        actions: Action space of the raw actions.
        sample_actions: Policy, from normalised observations [R, K * D] to raw actions [R, A].
        count: Rollouts per model.
        horizon: H.
        generator: Random generator for the noise.
    """
    inputs, obs_size = _inputs(frozen, start, count, 1), start.shape[-1]
    mean, _, raw, _, _ = frozen.layout.slices
    noise = sample_noise(frozen, len(start), count, 1, horizon, False, generator)
    plan = []
    for step in range(horizon):
        raw_actions = sample_actions(inputs[..., :obs_size].flatten(0, -2)).view(*inputs.shape[:-1], -1)
        plan.append(raw_actions)
        if step == horizon - 1:
            break
        inputs[..., obs_size:] = action_features(actions, raw_actions)
        out = frozen.dense(inputs.view(frozen.members, -1, frozen.inputs)).view(*inputs.shape[:-1], -1)
        _advance(frozen, inputs[..., :obs_size], out[..., mean], out[..., raw].sigmoid_(), noise[step])
    return torch.stack(plan, -2).squeeze(3).movedim(0, 1).flatten(1, 2)


def _inputs(frozen: FrozenEnsemble, start: Tensor, samples: int, particles: int) -> Tensor:
    """Return inputs of the networks [M, N, S, P, inputs] for the start, with action features still to be filled in."""
    envs, obs_size = start.shape
    inputs = start.new_empty(frozen.members, envs, samples, particles, frozen.inputs)
    inputs[..., :obs_size] = start[:, None, None]
    return inputs


def _advance(frozen: FrozenEnsemble, obs: Tensor, mean: Tensor, spread: Tensor, noise: Tensor) -> None:
    """Replace normalised observations [..., K * D] by the next ones, in place.

    The stack shifts by one frame. The newest frame changes by a sample of
    N(mean, min_variance + variance_scale · spread).
    """
    size, newest = frozen.layout.frame, obs[..., -frozen.layout.frame :]
    std = torch.addcmul(frozen.min_variance, frozen.variance_scale, spread).sqrt_()
    moved = torch.addcmul(newest + mean, std, noise)
    if frozen.frames > 1:
        obs[..., :-size] = obs[..., size:].clone()
    obs[..., -size:] = moved if frozen.clip is None else moved.clamp_(-frozen.clip, frozen.clip)
