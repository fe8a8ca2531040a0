"""Imagined rollouts of candidate plans in all models at once, and their returns and costs.

Letters: M models, N environments, S candidates, P particles of each candidate in each model, H steps ahead, K frames of
D numbers, F numbers of an action, C costs. Loops go over steps alone.
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
"""What is still to come: of normalised observations [R, K * D] and the raw actions [R, A] before them, [R]."""


@dataclass(frozen=True)
class Futures:
    """What candidates lead to, over all models and particles."""

    returns: Tensor
    """[N, S], the mean."""
    rewards: Tensor
    """[N, S], the part of it that comes within the horizon."""
    costs: Tensor
    """[N, S, C] within the horizon."""


@dataclass(frozen=True)
class Steps:
    """What every future meets at every step: rewards and ends [H, M, N, S, P], costs [H, M, N, S, P, C], and the
    normalised observation after the last step [M, N, S, P, K * D]."""

    rewards: Tensor
    costs: Tensor
    ends: Tensor
    last: Tensor


def sample_noise(
    frozen: FrozenEnsemble,
    envs: int,
    samples: int,
    particles: int,
    horizon: int,
    shared: bool,
    generator: torch.Generator,
) -> Tensor:
    """Standard normal disturbances [H, M, N, S or 1, P, D]; `shared`: the same for all candidates of an environment."""
    shape = (horizon, frozen.members, envs, 1 if shared else samples, particles, frozen.layout.frame)
    return torch.randn(shape, generator=generator, device=generator.device)


def imagine_rollouts(
    frozen: FrozenEnsemble, start: Tensor, features: Tensor, noise: Tensor, *, needs_last: bool = True
) -> Steps:
    """Carry out N * S plans in every model.

    Args:
        frozen: The models.
        start: Normalised observations [N, K * D].
        features: Of the planned actions [H, N, S, F].
        noise: [H, M, N, S or 1, P, D].
        needs_last: Whether anybody will look at the observations after the last step.

    At the first step all particles of a candidate in a model still coincide, so it is computed for one of them.
    """
    (horizon, envs, samples), layout, members = features.shape[:3], frozen.layout, frozen.members
    particles, seen = noise.shape[-2], start.shape[-1]
    mean, reward, raw, cost, _ = layout.parts
    shape = (members, envs, samples, particles)
    outputs = start.new_empty(horizon, *shape, 2 + layout.costs)
    inputs = _inputs(frozen, start, samples, 1)
    for step in range(horizon):
        inputs[..., seen:] = features[step].unsqueeze(-2)
        out = frozen.dense(inputs.view(members, -1, frozen.inputs)).view(*inputs.shape[:-1], -1)
        out[..., raw.start :].sigmoid_()
        outputs[step, ..., :1] = out[..., reward]
        outputs[step, ..., 1:] = out[..., cost.start :]
        if step == horizon - 1 and not needs_last:
            break
        if step == 0:
            inputs = _inputs(frozen, start, samples, particles)
        _move(frozen, inputs[..., :seen], out[..., mean], out[..., raw], noise[step])
    costs = frozen.cost_low + frozen.cost_range * outputs[..., 1:-1]
    return Steps(outputs[..., 0], costs, outputs[..., -1], inputs[..., :seen])


def evaluate_rollouts(
    steps: Steps,
    discount: float,
    cost_over: CostOver,
    *,
    ends: bool = True,
    value: Value | None = None,
    last_actions: Tensor | None = None,
) -> Futures:
    """What the futures are worth.

    Args:
        steps: From `imagine_rollouts`.
        discount: γ.
        cost_over: The cost of a step is the mean, or the largest, of all models and particles.
        ends: Whether episodes can end.
        value: What is still to come after the last step; None for nothing.
        last_actions: [N, S, A], raw, of the last step; for `value`.
    """
    alive = planning.survival(steps.ends if ends else torch.zeros_like(steps.ends))
    rewards = planning.imagined_return(steps.rewards, alive, discount)
    returns, shape = rewards, rewards.shape
    if value is not None and last_actions is not None:
        actions = last_actions.unsqueeze(-2).expand(*shape, -1)
        final = value(steps.last.flatten(0, -2), actions.flatten(0, -2)).view(shape)
        returns = planning.imagined_return(steps.rewards, alive, discount, final)
    each = planning.imagined_cost(steps.costs, alive)
    over = each.mean((1, 4)) if cost_over == "mean" else each.amax((1, 4))
    return Futures(returns.mean((0, 3)), rewards.mean((0, 3)), over.sum(0))


def rollout_policy(
    frozen: FrozenEnsemble,
    start: Tensor,
    actions: Actions,
    drawn: Callable[[Tensor], Tensor],
    count: int,
    horizon: int,
    generator: torch.Generator,
) -> Tensor:
    """What somebody would do [N, M * count, H, A], raw, `count` times in each model.

    Args:
        frozen: The models.
        start: Normalised observations [N, K * D].
        actions: What raw means.
        drawn: Raw actions [R, A] for normalised observations [R, K * D].
        count: Futures in each model.
        horizon: H.
        generator: Of the disturbances.
    """
    inputs, seen = _inputs(frozen, start, count, 1), start.shape[-1]
    mean, _, raw, _, _ = frozen.layout.parts
    noise = sample_noise(frozen, len(start), count, 1, horizon, False, generator)
    taken = []
    for step in range(horizon):
        now = drawn(inputs[..., :seen].flatten(0, -2)).view(*inputs.shape[:-1], -1)
        taken.append(now)
        if step == horizon - 1:
            break
        inputs[..., seen:] = action_features(actions, now)
        out = frozen.dense(inputs.view(frozen.members, -1, frozen.inputs)).view(*inputs.shape[:-1], -1)
        _move(frozen, inputs[..., :seen], out[..., mean], out[..., raw].sigmoid_(), noise[step])
    return torch.stack(taken, -2).squeeze(3).movedim(0, 1).flatten(1, 2)


def _inputs(frozen: FrozenEnsemble, start: Tensor, samples: int, particles: int) -> Tensor:
    """[M, N, S, P, inputs] with the start in place; the actions are still to be written."""
    envs, seen = start.shape
    inputs = start.new_empty(frozen.members, envs, samples, particles, frozen.inputs)
    inputs[..., :seen] = start[:, None, None]
    return inputs


def _move(frozen: FrozenEnsemble, obs: Tensor, mean: Tensor, spread: Tensor, noise: Tensor) -> None:
    """Write the next normalised observations [..., K * D] over the last ones: older frames move on, the newest changes
    by a draw from N(mean, least + most · spread)."""
    size, newest = frozen.layout.frame, obs[..., -frozen.layout.frame :]
    std = torch.addcmul(frozen.least, frozen.most, spread).sqrt_()
    moved = torch.addcmul(newest + mean, std, noise)
    if frozen.frames > 1:
        obs[..., :-size] = obs[..., size:].clone()
    obs[..., -size:] = moved if frozen.clip is None else moved.clamp_(-frozen.clip, frozen.clip)
