"""Advantages by generalised advantage estimation, and one-step temporal-difference targets.

Both distinguish the two ways in which an episode ends. After a termination there is no further return, so the value of
the next state is 0. After a truncation, the critic's value of the final observation replaces the return that the time
limit cut off. Letters: T steps, then any
further dimensions (N environments); B rows; S signals, the reward and the costs.
"""

import torch
from torch import Tensor

from thalweg.algos.maths.shapes import rank, same_shape


def gae(
    rewards: Tensor,
    values: Tensor,
    next_values: Tensor,
    terminated: Tensor,
    truncated: Tensor,
    *,
    discount: float,
    trace: float,
) -> Tensor:
    """Return advantages [T, ...] by generalised advantage estimation (Schulman et al. 2016, equations 11 and 16).

        δ_t = r_t + γ (1 - terminated_t) V(s_{t+1}) - V(s_t)
        Â_t = Σ_l (γλ)^l δ_{t+l}, where the sum stops at the end of the episode of step t

    Args:
        rewards: [T, ...], r_t: reward or cost of step t.
        values: [T, ...], V(s_t).
        next_values: [T, ...], V of the state that step t reached. At the last step of an episode this is the final
            observation, never the first observation of the next episode.
        terminated: [T, ...] bool, whether the episode ended in step t; V(s_{t+1}) then counts as 0.
        truncated: [T, ...] bool, whether the episode was cut off after step t; V(s_{t+1}) then replaces the
            missing return.
        discount: γ in 0..1.
        trace: λ in 0..1.

    Raises `ValueError` if the shapes differ.
    """
    same_shape(rewards=rewards, values=values, next_values=next_values, terminated=terminated, truncated=truncated)
    deltas = rewards + discount * torch.where(terminated, 0.0, next_values) - values
    carry = discount * trace * (~(terminated | truncated)).to(deltas.dtype)
    advantages = torch.empty_like(deltas)
    running = torch.zeros_like(deltas[0])
    for step in range(len(deltas) - 1, -1, -1):
        running = deltas[step] + carry[step] * running
        advantages[step] = running
    return advantages


def standardised(advantages: Tensor) -> Tensor:
    """Return advantages [B] scaled to mean 0 and standard deviation 1: (A - mean) / (population std + 1e-8)."""
    return (advantages - advantages.mean()) / (advantages.std(correction=0) + 1e-8)


def centred(advantages: Tensor) -> Tensor:
    """Return advantages [B] shifted to mean 0."""
    return advantages - advantages.mean()


def td_target(signals: Tensor, continues: Tensor, next_values: Tensor, discounts: Tensor) -> Tensor:
    """Return one-step targets y = x + γ continues V(s') [S, B] of action values (Watkins, Dayan 1992).

    Args:
        signals: x [S, B], reward and costs of the step.
        continues: [S, B] floats, 0 where nothing of the signal comes after the step, else 1: a truncated step keeps
            the value of a signal that goes on beyond the limit.
        next_values: V(s') [S, B], at the observation that the step reached.
        discounts: γ [S, 1].
    """
    rank(2, signals=signals, discounts=discounts)
    same_shape(signals=signals, next_values=next_values, continues=continues)
    return signals + discounts * (continues * next_values)
