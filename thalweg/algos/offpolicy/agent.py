"""What do off-policy algorithms do alike? Remember steps, draw batches of them at a set pace, step along a gradient,
let the slow copies follow, and be put away and brought back.

What an action will be worth, the policy's loss and the order of a gradient step are absent on purpose: they are the
algorithm, and stand in its file (what DDPG and TD3 have alike in `deterministic`).
"""

import math
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from thalweg.algos.common.adam import Adam
from thalweg.algos.common.cuda_graphs import CudaGraphs
from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.settings import as_data
from thalweg.algos.common.state import (
    CPU,
    array_of,
    generator_state,
    load_generator,
    load_module,
    module_state,
    new_generator,
    tensor_of,
)
from thalweg.algos.constraint.cost_limits import cost_metrics, cost_suffixes, limit_warnings
from thalweg.algos.constraint.multiplier import Multipliers
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.maths import advantages, losses
from thalweg.algos.offpolicy.config import OffPolicyConfig
from thalweg.algos.offpolicy.critics import Critics, Slow
from thalweg.algos.offpolicy.mean_metrics import Tally
from thalweg.algos.offpolicy.replay import Batch, Replay, steps_of
from thalweg.algos.policy.actions import Actions
from thalweg.algos.policy.networks import StackedMLP
from thalweg.algos.policy.normaliser import Normaliser
from thalweg.algos.policy.policy import About, Policy

CRITICS, POLICY = 0, 1
"""Groups of what is tallied."""
ALMOST = 1e-9
"""Gradient steps that rounding may have lost."""


class Agent:
    """A policy, critics of its actions, their slow copies, the replay, and where all that is random comes from."""

    def __init__(
        self,
        algorithm: str,
        config: OffPolicyConfig,
        task: Task,
        actions: Actions,
        *,
        coded: int,
        reward_critics: int,
        outputs: int = 0,
        greedy: bool = False,
        tallied: tuple[str, ...] = (),
    ) -> None:
        """Make everything anew.

        Args:
            algorithm: Its name.
            config: Its settings.
            task: What it is made for.
            actions: How the policy sees the action space.
            coded: W, numbers of an action in the replay.
            reward_critics: How many critics the reward has.
            outputs: Numbers that a critic says of an observation; 0: one number, of an observation and an action.
            greedy: Whether the policy is its most probable action.
            tallied: Names of further numbers that each step of the policy gives.
        """
        self.config, self.num_envs = config, task.num_envs
        self.generator = new_generator(task.device, task.seed)
        size, costs = config.frame_stack * task.obs_size, len(config.limits)
        self.policy = Policy(
            task.obs_size,
            actions,
            config.shape,
            frames=config.frame_stack,
            normalise=config.normalise_observations,
            greedy=greedy,
            generator=self.generator,
            about=About(algorithm, as_data(config), task.context),
        )
        self.critics = Critics(
            reward_critics,
            costs,
            config.cost_critics,
            inputs=size if outputs else size + coded,
            outputs=outputs or 1,
            shape=config.shape,
            generator=self.generator,
        )
        self.slow = Slow([self.policy.actor.stack, self.critics.stack])
        self.policy_optimiser = Adam([self.policy.actor.stack.flat], config.learning_rate)
        self.critic_optimiser = Adam([self.critics.stack.flat], config.critic_learning_rate)
        self.multipliers = Multipliers(config, config.limits)
        self.replay = Replay(config.replay_size, size, coded, costs, task.device)
        self._costs_seen = Normaliser(costs, config.normalise_cost, task.device)
        discounts = [[config.discount], *[[config.cost_discount]] * costs]
        self._discounts = torch.tensor(discounts, device=task.device)
        names = ["", *(f"cost{name}_" for name in cost_suffixes(costs))]
        self._tally = Tally(
            (*(f"{name}q_loss" for name in names), *(f"{name}q_mean" for name in names)),
            ("policy_loss", *tallied),
            device=task.device,
        )
        self._graphs = CudaGraphs(task.graphs, [self.generator])
        self.steps, self.gradient_steps, self.progress = 0, 0, 0.0
        """`progress`: the share of the run that was over when it last learnt."""
        self._owed, self._reported_at = 0.0, 0

    @property
    def rollout_steps(self) -> int:
        """T: steps of each environment between two rounds of learning."""
        return max(1, self.config.steps_per_collection // self.num_envs)

    @property
    def slow_actor(self) -> StackedMLP:
        """The policy's slow copy."""
        return self.slow.copies[0]

    @property
    def slow_critics(self) -> StackedMLP:
        return self.slow.copies[1]

    @property
    def begins(self) -> bool:
        """Whether actions are still drawn uniformly."""
        return self.steps < self.config.random_steps

    def parameters(self, obs: Tensor) -> Tensor:
        """[N, P] of the policy at observations float32 [N, K * D]."""
        return self.policy.actor(self.policy.normaliser(obs))

    def remember(self, rollout: Rollout, coded: Callable[[Tensor], Tensor]) -> None:
        """Put the rollout's valid steps into the replay, their raw actions [S, A] `coded` as [S, W].

        Raises `NotFiniteError` for NaN or infinity, and `AlgorithmError` for a negative cost where there is a floor.
        """
        obs, actions, next_obs, paid, going_on = steps_of(rollout)
        negative = paid[:, 1:][paid[:, 1:] < 0.0]
        if self.config.cost_floor and len(negative):
            raise AlgorithmError(f"a step cost {negative[0]:g}; with cost_floor none may be negative: set it to false")
        self.policy.normaliser.update(obs)
        self._costs_seen.update(paid[:, 1:])
        paid = torch.cat([paid[:, :1], self._costs_seen(paid[:, 1:])], 1)
        self.replay.add(obs, coded(actions), next_obs, paid, going_on)
        self.steps += len(obs)
        self._owed += self.config.updates_per_step * max(0, min(len(obs), self.steps - self.config.random_steps))

    def learn(self, feedback: Feedback, step: Callable[[Batch], None]) -> None:
        """Take each gradient step that is due, from a batch of its own; afterwards nothing tallied has been NaN, else
        `NotFiniteError`."""
        self.progress = feedback.progress
        rate = self.config.learning_rate * (1.0 - feedback.progress if self.config.linear_decay else 1.0)
        self.policy_optimiser.rate = rate
        if not self.gradient_steps:
            self.slow.catch_up()  # the policy may have begun as another since they were made
        count = int(self._owed + ALMOST)
        self._owed -= count
        for rows in self.replay.batches(count, self.config.minibatch, self.generator, self.policy.normaliser):
            turn = self.policy_turn
            self._graphs.run(lambda rows: step(self.replay.batch(rows)), rows, turn, self.multipliers.values)
            self._tally.count(CRITICS)
            if turn:
                self._tally.count(POLICY)
            self.gradient_steps += 1
            if self.config.multiplier_schedule == "gradient_step":
                self.multipliers.update(feedback)
        self._tally.require_finite()

    @property
    def policy_turn(self) -> bool:
        """Whether this gradient step, whose batch is at hand, improves the policy too."""
        return (self.gradient_steps + 1) % self.config.policy_delay == 0

    @torch.no_grad()
    def learn_values(
        self,
        said: Tensor,
        back: Callable[[Tensor], None],
        batch: Batch,
        next_values: Tensor,
        chosen: Tensor | None = None,
    ) -> None:
        """One step of Adam of all critics down ½ E[(Q - y)²], summed over critics (`maths.bootstrap`).

        Args:
            said: [K, B, W] what the critics put out.
            back: What their stack's `ahead` gave beside it.
            batch: What was remembered.
            next_values: V(s') [S, B], before any floor.
            chosen: Which of the W numbers is Q of the batch's actions, [B] int64; None: there is but one.
        """
        if self.config.cost_floor:
            next_values = torch.cat([next_values[:1], next_values[1:].clamp(min=0.0)])
        place = None if chosen is None else chosen.expand(len(said), -1).unsqueeze(-1)
        values = (said if place is None else said.gather(-1, place)).squeeze(-1)
        targets = advantages.td_target(batch.paid, batch.going_on, next_values, self._discounts)[self.critics.signal]
        slopes = losses.squared_error_grad(values, targets).unsqueeze(-1)
        back(slopes if place is None else torch.zeros_like(said).scatter_(-1, place, slopes))
        self.critic_optimiser.step(self.config.max_grad_norm)
        errors, leading = losses.squared_error(values, targets), self.critics.leading
        self._tally.add(CRITICS, torch.cat([errors[leading], values[leading].mean(-1)]))

    def improve(self, loss: Tensor, *tallied: Tensor) -> None:
        """One step of Adam of the policy down the gradient that has been left in it, of this scalar; then all slow
        copies follow."""
        self.policy_optimiser.step(self.config.max_grad_norm)
        self.slow.follow(self.config.target_rate)
        self._tally.add(POLICY, torch.stack([loss, *tallied]).detach())

    def report(self, feedback: Feedback) -> dict[str, float]:
        """Metrics, if they are due: then the multipliers have moved first."""
        if self.steps - self._reported_at < self.config.steps_per_update and feedback.steps_left:
            return {}
        self._reported_at = self.steps
        if self.config.multiplier_schedule == "report" and self.gradient_steps:
            self.multipliers.update(feedback)
        return (
            self._tally.report()
            | {
                "gradient_steps": self.gradient_steps,
                "replay": self.replay.filled,
                "learning_rate": self.policy_optimiser.rate,
            }
            | self.multipliers.metrics(feedback, self._moves_left(feedback))
            | cost_metrics(feedback, self.config.limits, self.config.cost_window)
        )

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """What keeps the cost limits or their multipliers from doing their work."""
        return limit_warnings(self.config.limits, feedback) | self.multipliers.warnings(
            feedback, self._moves_left(feedback)
        )

    def state(self) -> dict[str, Any]:
        """Everything, as nested dictionaries of arrays and plain data."""
        return {
            "actor": module_state(self.policy.actor),
            "critics": module_state(self.critics.stack),
            "slow": array_of(self.slow.slow),
            "policy_optimiser": self.policy_optimiser.state(),
            "critic_optimiser": self.critic_optimiser.state(),
            "multipliers": self.multipliers.state(),
            "normaliser": self.policy.normaliser.state(),
            "costs_seen": self._costs_seen.state(),
            "replay": self.replay.state(),
            "generator": generator_state(self.generator),
            "tally": self._tally.state(),
            "steps": self.steps,
            "gradient_steps": self.gradient_steps,
            "progress": self.progress,
            "owed": self._owed,
            "reported_at": self._reported_at,
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`; further keys are not looked at."""
        load_module(self.policy.actor, state["actor"])
        load_module(self.critics.stack, state["critics"])
        self.slow.slow.copy_(tensor_of(state["slow"], CPU))
        self.policy_optimiser.load_state(state["policy_optimiser"])
        self.critic_optimiser.load_state(state["critic_optimiser"])
        self.multipliers.load_state(state["multipliers"])
        self.policy.normaliser.load_state(state["normaliser"])
        self._costs_seen.load_state(state["costs_seen"])
        self.replay.load_state(state["replay"])
        load_generator(self.generator, state["generator"])
        self._tally.load_state(state["tally"])
        self.steps, self.gradient_steps = int(state["steps"]), int(state["gradient_steps"])
        self.progress = float(state["progress"])
        self._owed, self._reported_at = float(state["owed"]), int(state["reported_at"])

    def _moves_left(self, feedback: Feedback) -> int:
        """How often the multipliers will still move."""
        left = max(feedback.steps_left - max(self.config.random_steps - self.steps, 0), 0)
        if self.config.multiplier_schedule == "gradient_step":
            return int(left * self.config.updates_per_step)
        return math.ceil(left / self.config.steps_per_update)
