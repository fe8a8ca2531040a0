"""SafeLOOP (Sikchi, Zhou, Held 2021): a soft actor-critic proposes plans to a planner (SafeARC) and estimates the
return after its horizon; the planner keeps the cost within the budget.

Discrete actions use exact sums over all joint actions (Christodoulou 2019), continuous ones a reparameterised sample.
"""

import copy
import math
from collections.abc import Callable
from typing import Annotated, Any, Self

import torch
from pydantic import Field, NonNegativeInt, model_validator
from torch import Tensor, nn

from thalweg.algos.common.adam import Adam
from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.setting_types import EntropyPerNumber
from thalweg.algos.common.state import CPU, array_of, load_module, module_state, tensor_of
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.maths import advantages, losses, planning
from thalweg.algos.planning.agent import Agent
from thalweg.algos.planning.config import PlanningConfig, Size, Sizes
from thalweg.algos.planning.imagined_rollouts import PlanOutcomes, Value, rollout_policy
from thalweg.algos.planning.model.ensemble import FrozenEnsemble
from thalweg.algos.planning.model.transitions import Batch
from thalweg.algos.planning.planner import Budget
from thalweg.algos.planning.policy import METHODS
from thalweg.algos.planning.soft_actor_critic import soft_actor_critic
from thalweg.algos.policy.actions import Actions
from thalweg.core.config import FiniteNonNegative, FinitePositive, Fraction, frozen_config

SIZES: dict[Size, Sizes] = {
    "small": Sizes(samples=32, particles=1, iterations=3, elites=6, horizon=5, model_hidden=(64, 64)),
    "lite": Sizes(samples=64, particles=1, iterations=4, elites=8, horizon=5, model_hidden=(128, 128)),
    "full": Sizes(samples=100, particles=4, iterations=5, elites=20, horizon=7, model_hidden=(200, 200, 200, 200)),
}


@frozen_config(AlgorithmError)
class SafeLOOPConfig(PlanningConfig):
    """Settings of SafeLOOP."""

    proposals: NonNegativeInt = 2
    """Plans that the actor proposes in each model of the ensemble."""
    proposal_share: Fraction = 0.5
    """Weight of these plans in the initial plan of each decision; the rest is that of the previous decision."""
    sharpness: FinitePositive = 2.0
    """β: inverse temperature of the weights of feasible candidates."""
    cost_sharpness: FinitePositive = 4.0
    """β_c: inverse temperature of the weights by cost, used where too few candidates are feasible."""
    standardise_returns: bool = True
    """Whether β and β_c apply to standardised returns and costs of the candidates; else to those of an episode, each
    horizon's times the horizons per episode, as in OmniSafe."""
    stale_action_value: bool = False
    """Whether the value after the horizon is that of the last state with the action before it, as in OmniSafe; else
    with the actor's action."""
    alpha: FiniteNonNegative = 0.2
    """α: weight of the actor's entropy in nats; with `auto_alpha` its initial value."""
    auto_alpha: bool = True
    """Whether α is adapted to keep the actor's entropy at a target."""
    alpha_learning_rate: FiniteNonNegative = 1e-3
    """Learning rate of Adam for log α."""
    alpha_decay: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Factor of α after each gradient step without `auto_alpha`."""
    entropy_share: Fraction = 0.1
    """Target entropy of a discrete actor, as a share of the maximum, log(number of joint actions)."""
    entropy_per_number: EntropyPerNumber = -1.0
    """Target entropy of a continuous actor in -1..1, in nats per dimension of the action."""
    entropy_in_targets: bool = False
    """Whether targets contain α times the entropy of later decisions, as in the paper; else it counts in the actor's
    loss alone."""
    learning_rate: FiniteNonNegative = 1e-3
    """Learning rate of Adam for the actor."""
    discount: Fraction = 0.9
    """γ of the critics, for the reward after the horizon. They estimate the best an actor can do from few data, and err
    more than those of CCEPETS."""
    target_rate: Annotated[float, Field(gt=0, le=1)] = 0.005
    """How far the target critics move towards the critics at each gradient step."""
    standardise_rewards: bool = True
    """Whether critics learn rewards divided by their standard deviation, so that α is independent of the reward's
    scale."""

    @model_validator(mode="after")
    def _learnt_alpha_is_positive(self) -> Self:
        if self.auto_alpha and self.alpha == 0:
            raise ValueError("alpha must be above 0 with auto_alpha, got 0.0")
        return self

    def sized(self) -> Sizes:
        return SIZES[self.size]


class SafeARC:
    """Weighting, terminal value and proposals of SafeLOOP's planner (SafeARC)."""

    mean_momentum = 0.0

    def __init__(
        self,
        config: SafeLOOPConfig,
        actions: Actions,
        inputs: int,
        reward_std: Callable[[], Tensor],
        generator: torch.Generator,
    ) -> None:
        self.config, self.actions, self._reward_std = config, actions, reward_std
        self.proposal_share = config.proposal_share
        self.soft = soft_actor_critic(actions, config, inputs, generator)
        self.modules = nn.ModuleDict({"actor": self.soft.actor, "critics": self.soft.critics})

    @property
    def unit(self) -> Tensor | float:
        """Unit of the critics: the standard deviation of rewards with `standardise_rewards`, else 1."""
        return self._reward_std() if self.config.standardise_rewards else 1.0

    def weights(self, outcomes: PlanOutcomes, budget: Budget) -> Tensor:
        """Return weights [N, S]: w ∝ exp(β G) over feasible candidates, or exp(-β_c C) over all if those are too few.

        With `standardise_returns`, several costs are summed in units of their budgets, so that no size matters.
        """
        config, returns, costs = self.config, outcomes.returns, outcomes.costs
        feasible = (costs <= budget.costs).all(-1)
        if config.standardise_returns:
            total = planning.standardised_rows(planning.in_budgets(costs, budget.costs), torch.ones_like(feasible))
            returns = planning.standardised_rows(returns, feasible)
        else:
            total, returns = costs.sum(-1) * budget.per_episode, returns * budget.per_episode
        return planning.feasible_softmax(
            returns, total, feasible, config.sizes.elites, config.sharpness, config.cost_sharpness
        )

    def value(self) -> Value | None:
        """Return the terminal value E_a[min Q(s_H, a)] under the actor, in units of the reward.

        Continuous actions use the actor's mode; `stale_action_value` uses the action that led to s_H instead.
        """
        if self.config.stale_action_value:
            return lambda obs, before: self.soft.action_value(obs, before) * self.unit
        return lambda obs, _: self.soft.value(obs) * self.unit

    def proposals(self, frozen: FrozenEnsemble, start: Tensor, generator: torch.Generator) -> Tensor | None:
        """Return raw actions of the actor in rollouts of each model [N, G, H, A]; None if `proposals` is 0."""
        if not self.config.proposals:
            return None
        return rollout_policy(
            frozen,
            start,
            self.actions,
            lambda obs: self.soft.sample(obs, generator),
            self.config.proposals,
            self.config.sizes.horizon,
            generator,
        )


METHODS["SafeLOOP"] = (SafeLOOPConfig, SafeARC)


def actor_loss(values: Tensor, entropy: Tensor, alpha: Tensor) -> Tensor:
    """Return the actor's loss L = -E_s[E_a[min Q(s, a)] + α H(s)] [], from values and entropy [B].

    Source: Haarnoja et al. 2018, equation 12. It contains no cost: the planner alone enforces the cost limit.
    """
    return -(values + alpha * entropy).mean()


class SafeLOOP:
    """SafeLOOP: acts by planning, fits the model, and trains actor, critics and α."""

    resets = False

    def __init__(self, config: SafeLOOPConfig, task: Task) -> None:
        self.config, self.separate_costs = config, config.separate_costs
        self.agent = Agent("SafeLOOP", config, task, ("value_loss", "value", "actor_loss", "entropy", "alpha"))
        self.policy, self.rollout_steps = self.agent.policy, self.agent.rollout_steps
        method = self.policy.method
        assert isinstance(method, SafeARC)
        self.method, self.soft, self.target_critics = method, method.soft, copy.deepcopy(method.soft.critics)
        log_alpha = torch.tensor(max(config.alpha, 1e-30), dtype=torch.float32, device=task.device).log()
        self.log_alpha = log_alpha.requires_grad_(config.auto_alpha)
        self.actor_optimiser = Adam(self.soft.actor.parameters(), config.learning_rate)
        self.optimiser = Adam(self.soft.critics.parameters(), config.critic_learning_rate)
        self.alpha_optimiser = Adam([self.log_alpha], config.alpha_learning_rate)

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Return raw actions [N, A]: random for the first `random_steps`, then planned."""
        return self.agent.act(obs, fresh)

    def warm_up_critics(self) -> None:
        """Do nothing: a planner can't start from another run's policy."""

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Store the rollout, fit the model, train critics and actor; returns the metrics, empty when none are due."""
        self.agent.learn(rollout)
        for batch in self.agent.critic_batches():
            self._step(batch)
        return self.agent.report(feedback)

    def _step(self, batch: Batch) -> None:
        """Take one gradient step of the critics, the actor and α."""
        ensemble, soft, alpha = self.policy.ensemble, self.soft, self.log_alpha.detach().exp()
        obs, generator = ensemble.normalised(batch.obs), self.agent.generator
        with torch.no_grad():
            weight = alpha if self.config.entropy_in_targets else torch.zeros_like(alpha)
            next_v = soft.next_values(self.target_critics, ensemble.normalised(batch.next_obs), weight, generator)
            next_v = self.agent.bounded(next_v, self.method.unit, *self._entropy_slack(weight))
            target = advantages.td_target(
                (batch.rewards / self.method.unit).unsqueeze(0),
                (~batch.terminated).float().unsqueeze(0),
                next_v.unsqueeze(0),
                next_v.new_tensor([[self.config.discount]]),
            )
        q_values = soft.q_values(obs, batch.actions)
        errors = losses.squared_error(q_values, target.expand_as(q_values))
        _descend(self.optimiser, errors.sum())
        values, entropy = soft.objective(obs, generator)
        loss = actor_loss(values, entropy, alpha)
        _descend(self.actor_optimiser, loss)
        if self.config.auto_alpha:
            _descend(self.alpha_optimiser, losses.temperature(self.log_alpha, entropy, soft.target_entropy))
        else:
            self.log_alpha += math.log(self.config.alpha_decay)
        self.target_critics.flat.data.lerp_(soft.critics.flat.detach(), self.config.target_rate)
        self.agent.log(
            value_loss=errors.detach().mean(),
            value=q_values.detach().mean(),
            actor_loss=loss.detach(),
            entropy=entropy.detach().mean(),
            alpha=alpha,
        )

    def _entropy_slack(self, weight: Tensor) -> tuple[float, float | Tensor]:
        """Return how far soft values may lie below and above what an episode pays, for the entropy's weight."""
        least, most = self.soft.entropy_range
        decisions = 1.0 / max(1.0 - self.config.discount, 1e-3)
        below = math.inf if self.config.entropy_in_targets and least < 0.0 else 0.0
        return below, weight * (most * decisions)

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """Return warnings about cost limits, and values that no episode can pay."""
        weight = (
            self.log_alpha.detach().exp() if self.config.entropy_in_targets else torch.zeros((), dtype=torch.float32)
        )
        below, above = (float(slack) for slack in self._entropy_slack(weight))
        return self.agent.warnings(feedback, float(self.method.unit), below, above)

    def state(self) -> dict[str, Any]:
        return self.agent.state() | {
            "slow": module_state(self.target_critics),
            "log_alpha": array_of(self.log_alpha),
            "optimiser": self.optimiser.state(),
            "actor_optimiser": self.actor_optimiser.state(),
            "alpha_optimiser": self.alpha_optimiser.state(),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        self.agent.load_state(state)
        load_module(self.target_critics, state["slow"])
        with torch.no_grad():
            self.log_alpha.copy_(tensor_of(state["log_alpha"], CPU))
        self.optimiser.load_state(state["optimiser"])
        self.actor_optimiser.load_state(state["actor_optimiser"])
        self.alpha_optimiser.load_state(state["alpha_optimiser"])


def _descend(optimiser: Adam, loss: Tensor) -> None:
    """Take one optimiser step that reduces a scalar loss."""
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
