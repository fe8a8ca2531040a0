"""Returns and costs of imagined trajectories, and the cross-entropy method's updates of a plan.

Letters: H steps ahead, N environments, S candidates, A branches or numbers of an action, K options, M costs.
"""

import torch
from torch import Tensor

from thalweg.algos.maths.shapes import rank, same_shape


def survival(ends: Tensor) -> Tensor:
    """Return S_t = Π_{k<t} (1 - p_end,k) [H + 1, ...], the probability that the episode reaches each time step.

    Args:
        ends: [H, ...], p_end of each step: the probability that the step ends the episode, if it is reached.
    """
    alive = ends.new_ones(len(ends) + 1, *ends.shape[1:])
    torch.cumprod(1.0 - ends, 0, out=alive[1:])
    return alive


def imagined_return(rewards: Tensor, alive: Tensor, discount: float, final: Tensor | None = None) -> Tensor:
    """Return G [...] = Σ_{t<H} γ^t S_t r_t + γ^H S_H V(s_H): nothing counts after a termination.

    Args:
        rewards: [H, ...], the expected reward of each step, if it is reached.
        alive: S [H + 1, ...], from `survival`.
        discount: γ.
        final: V(s_H) [...], the expected return after the last step; None counts it as 0.
    """
    same_shape(rewards=rewards, alive=alive[:-1])
    powers = discount ** torch.arange(len(rewards) + 1, dtype=rewards.dtype, device=rewards.device)
    total = torch.tensordot(powers[:-1], alive[:-1] * rewards, 1)
    if final is None:
        return total
    same_shape(final=final, last=alive[-1])
    return total + powers[-1] * alive[-1] * final


def imagined_cost(costs: Tensor, alive: Tensor) -> Tensor:
    """Return S_t c_t [H, ..., M], the expected cost of each step; it is undiscounted, as the limit is.

    Args:
        costs: [H, ..., M], the expected cost of each step, if it is reached.
        alive: S [H + 1, ...], from `survival`.
    """
    same_shape(one_cost=costs[..., 0], alive=alive[:-1])
    return costs * alive[:-1].unsqueeze(-1)


def budget(limit: float, horizon: int, length: float, ending: float = 0.0) -> float:
    """Return the cost that H steps may have under a limit d on an episode: d (e + (1 - e) min(H / L, 1)).

    A cost that leaves the episode running is spread evenly. One that ends it is paid at most once: for it, the limit is
    a chance, and its even share would allow less than any step forward risks.

    Args:
        limit: d.
        horizon: H, in steps of the environment.
        length: L, the mean length of an episode; OmniSafe always uses 1000.
        ending: e, the share of all costs that ended their episodes.
    """
    return limit * (ending + (1.0 - ending) * min(horizon / length, 1.0))


def in_budgets(costs: Tensor, budgets: Tensor) -> Tensor:
    """Return b̄ Σ_i C_i / b_i [...], the sum of costs C [..., M] relative to their budgets b [M] with mean b̄.

    A single cost is returned unchanged.
    """
    budgets = budgets.clamp(min=1e-6)
    return (costs * (budgets.mean() / budgets)).sum(-1)


def elites(returns: Tensor, costs: Tensor, budgets: Tensor, count: int) -> Tensor:
    """Return the weights [N, S] of the constrained cross-entropy method (Wen, Topcu 2018, algorithm 1).

    They are 1/E for each elite and 0 for the other candidates. The elites are the E feasible candidates of highest
    return or, if fewer than E are feasible, the E of lowest cost. Several costs are compared by `in_budgets`.

    Args:
        returns: G [N, S].
        costs: C [N, S, M].
        budgets: b [M]; a candidate is feasible if C_i ≤ b_i for every cost.
        count: E.
    """
    rank(2, returns=returns)
    same_shape(returns=returns, one_cost=costs[..., 0])
    feasible = (costs <= budgets).all(-1)
    enough = feasible.sum(-1, keepdim=True) >= count
    score = torch.where(enough, returns.masked_fill(~feasible, -torch.inf), -in_budgets(costs, budgets))
    chosen = score.topk(count, dim=-1).indices
    return torch.zeros_like(returns).scatter_(-1, chosen, 1.0 / count)


def feasible_softmax(
    returns: Tensor, costs: Tensor, feasible: Tensor, least: int, sharpness: float, cost_sharpness: float
) -> Tensor:
    """Return the weights [N, S] of SafeARC (Sikchi, Zhou, Held 2021, algorithm 2 and section 4.3).

    If at least E candidates are feasible, w ∝ exp(β G) over those; otherwise w ∝ exp(-β_c C) over all.

    Args:
        returns: G [N, S].
        costs: C [N, S], all costs as one number: the standardised value of `in_budgets`, or their sum over an episode.
        feasible: [N, S] bool, whether every cost is within its budget.
        least: E.
        sharpness: β.
        cost_sharpness: β_c.
    """
    rank(2, returns=returns)
    same_shape(returns=returns, costs=costs, feasible=feasible)
    enough = feasible.sum(-1, keepdim=True) >= least
    pursuing = (sharpness * returns).masked_fill(~feasible, -torch.inf)
    return torch.where(enough, pursuing, -cost_sharpness * costs).softmax(-1)


def standardised_rows(values: Tensor, mask: Tensor) -> Tensor:
    """Return values [N, S] scaled per row to mean 0 and standard deviation 1 over those in `mask` [N, S]."""
    same_shape(values=values, mask=mask)
    count = mask.sum(-1, keepdim=True).clamp(min=1)
    mean = (values * mask).sum(-1, keepdim=True) / count
    variance = ((values - mean).square() * mask).sum(-1, keepdim=True) / count
    return (values - mean) / (variance.sqrt() + 1e-8)


def categorical_step(
    probabilities: Tensor, options: Tensor, weights: Tensor, exists: Tensor, momentum: float, floor: float
) -> Tensor:
    """Return the plan [N, H, A, K] after one step of the cross-entropy method (Rubinstein, Kroese 2004, section 4.2).

        p ← (1 - K f) (m p + (1 - m) Σ_s w_s 1{a_s = k}) + f

    Args:
        probabilities: p [N, H, A, K], of each option of each branch at each step ahead.
        options: a [N, S, H, A] int64.
        weights: w [N, S], of sum 1.
        exists: [A, K] bool, which options a branch has; K in the formula counts these, and no others are sampled.
        momentum: m.
        floor: f, the lowest probability of an option that exists.
    """
    rank(4, probabilities=probabilities, options=options)
    same_shape(one_option=probabilities[..., 0], one_candidate=options[:, 0])
    counts = torch.zeros_like(probabilities)
    shares = weights[:, :, None, None].expand(options.shape).movedim(1, -1)
    counts.scatter_add_(-1, options.movedim(1, -1), shares)
    mixed = momentum * probabilities + (1.0 - momentum) * counts
    return floored(mixed, exists, floor)


def floored(probabilities: Tensor, exists: Tensor, floor: float) -> Tensor:
    """Return (1 - K f) p + f [..., A, K] where the option exists, and 0 elsewhere."""
    options = exists.sum(-1, keepdim=True).to(probabilities.dtype)
    return ((1.0 - options * floor) * probabilities + floor) * exists


def gaussian_step(
    mean: Tensor,
    variance: Tensor,
    samples: Tensor,
    weights: Tensor,
    momentum: float,
    mean_momentum: float,
    largest: float,
) -> tuple[Tensor, Tensor]:
    """Return the mean and variance [N, H, A] of the plan after one step of the cross-entropy method.

        μ' = Σ_s w_s a_s,   σ'² = Σ_s w_s (a_s - μ')²
        μ ← m_μ μ + (1 - m_μ) μ',   σ² ← min(m σ² + (1 - m) σ'², largest)

    Args:
        mean: μ [N, H, A].
        variance: σ² [N, H, A].
        samples: a [N, S, H, A].
        weights: w [N, S], of sum 1.
        momentum: m, of the variance.
        mean_momentum: m_μ.
        largest: Upper bound of the variance.
    """
    same_shape(mean=mean, variance=variance, one_candidate=samples[:, 0])
    share = weights[:, :, None, None]
    best = (share * samples).sum(1)
    spread = (share * (samples - best.unsqueeze(1)).square()).sum(1)
    return (
        mean_momentum * mean + (1.0 - mean_momentum) * best,
        (momentum * variance + (1.0 - momentum) * spread).clamp(max=largest),
    )
