"""CCEPETS: the constrained cross-entropy method on a probabilistic ensemble (Wen, Topcu 2018; Chua et al. 2018). Each
decision searches for the plan with the highest return among those whose cost stays within the budget."""

import copy
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, nn

from thalweg.algos.common.adam import Adam
from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.state import load_module, module_state
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.maths import advantages, losses, planning
from thalweg.algos.planning.agent import Agent
from thalweg.algos.planning.config import PlanningConfig, Size, Sizes
from thalweg.algos.planning.imagined_rollouts import PlanOutcomes, Value
from thalweg.algos.planning.model.ensemble import FrozenEnsemble
from thalweg.algos.planning.model.transitions import Batch
from thalweg.algos.planning.planner import Budget
from thalweg.algos.planning.policy import METHODS
from thalweg.algos.policy.actions import Actions
from thalweg.algos.policy.networks import Critics, NetworkShape
from thalweg.core.config import frozen_config

SIZES: dict[Size, Sizes] = {
    "small": Sizes(samples=48, particles=1, iterations=3, elites=6, horizon=5, model_hidden=(64, 64)),
    "lite": Sizes(samples=64, particles=1, iterations=4, elites=8, horizon=5, model_hidden=(128, 128)),
    "full": Sizes(samples=512, particles=4, iterations=5, elites=64, horizon=7, model_hidden=(200, 200, 200, 200)),
}


@frozen_config(AlgorithmError)
class CCEPETSConfig(PlanningConfig):
    """Settings of CCEPETS."""

    terminal_value: bool = True
    """Whether a critic estimates the return after the horizon; else it counts as 0."""

    def sized(self) -> Sizes:
        return SIZES[self.size]


class Elites:
    """Weighting of CCEPETS: the best feasible candidates share all weight equally."""

    proposal_share = 0.0

    def __init__(
        self,
        config: CCEPETSConfig,
        actions: Actions,
        inputs: int,
        reward_std: Callable[[], Tensor],
        generator: torch.Generator,
    ) -> None:
        self.config, self.mean_momentum, self._reward_std = config, config.momentum, reward_std
        self.critic = Critics(1, inputs, NetworkShape(config.hidden), generator)
        """V(s), in standard deviations of the reward."""
        self.modules = nn.ModuleDict({"critic": self.critic} if config.terminal_value else {})

    def weights(self, outcomes: PlanOutcomes, budget: Budget) -> Tensor:
        """Return the weights [N, S]: 1/E for the E feasible candidates of highest return, 0 for the others.

        If fewer than E are feasible, the E candidates of lowest cost have the weights.
        """
        return planning.elites(outcomes.returns, outcomes.costs, budget.costs, self.config.sizes.elites)

    def value(self) -> Value | None:
        """Return V(s_H) in units of the reward; None without a terminal value."""
        if not self.config.terminal_value:
            return None
        return lambda obs, _: self.critic(obs)[0] * self._reward_std()

    def proposals(self, frozen: FrozenEnsemble, start: Tensor, generator: torch.Generator) -> Tensor | None:
        """Return None: all candidates are sampled from the plan."""
        return None


METHODS["CCEPETS"] = (CCEPETSConfig, Elites)


def value_loss(values: Tensor, next_values: Tensor, rewards: Tensor, terminated: Tensor, discount: float) -> Tensor:
    """Return the loss of the critic [], ½ E[(V(s) - r - γ (1 - terminated) V'(s'))²], from arguments of shape [B].

    The critic estimates the average return of the behaviour in the replay buffer, early exploration included (Sutton
    1988).
    """
    gamma = values.new_tensor([[discount]])
    continues = (~terminated).to(values.dtype)
    target = advantages.td_target(rewards.unsqueeze(0), continues.unsqueeze(0), next_values.unsqueeze(0), gamma)
    return losses.squared_error(values.unsqueeze(0), target)[0]


class CCEPETS:
    """CCEPETS: acts by planning, fits the model, and trains the terminal value."""

    resets = False

    def __init__(self, config: CCEPETSConfig, task: Task) -> None:
        self.config, self.separate_costs = config, config.separate_costs
        self.agent = Agent("CCEPETS", config, task, ("value_loss", "value") if config.terminal_value else ())
        self.policy, self.rollout_steps = self.agent.policy, self.agent.rollout_steps
        method = self.policy.method
        assert isinstance(method, Elites)
        self.critic, self.target_critic = method.critic, copy.deepcopy(method.critic)
        self.optimiser = Adam(self.critic.parameters(), config.critic_learning_rate)

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Return raw actions [N, A]: random for the first `random_steps`, then planned."""
        return self.agent.act(obs, fresh)

    def warm_up_critics(self) -> None:
        """Do nothing: a planner can't start from another run's policy."""

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Store the rollout, fit the model, then train the critic; returns the metrics, empty when none are due."""
        self.agent.learn(rollout)
        if self.config.terminal_value:
            for batch in self.agent.critic_batches():
                self._step(batch)
        return self.agent.report(feedback)

    def _step(self, batch: Batch) -> None:
        """Take one gradient step of the critic."""
        ensemble = self.policy.ensemble
        with torch.no_grad():
            next_values = self.target_critic(ensemble.normalised(batch.next_obs))[0]
            next_values = self.agent.bounded(next_values, ensemble.reward.std)
        values = self.critic(ensemble.normalised(batch.obs))[0]
        loss = value_loss(
            values, next_values, batch.rewards / ensemble.reward.std, batch.terminated, self.config.discount
        )
        self.optimiser.zero_grad()
        loss.backward()
        self.optimiser.step()
        self.target_critic.stack.flat.data.lerp_(self.critic.stack.flat.detach(), self.config.target_rate)
        self.agent.log(value_loss=loss.detach(), value=values.detach().mean())

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """Return warnings about cost limits, and values that no episode can pay."""
        return self.agent.warnings(feedback, float(self.policy.ensemble.reward.std))

    def state(self) -> dict[str, Any]:
        return self.agent.state() | {
            "slow": module_state(self.target_critic),
            "optimiser": self.optimiser.state(),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        self.agent.load_state(state)
        load_module(self.target_critic, state["slow"])
        self.optimiser.load_state(state["optimiser"])
