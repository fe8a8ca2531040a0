"""Agent of off-policy algorithms: stores steps, samples batches on schedule, updates critics, policy and target
networks, and saves its state.

Target values, the policy's loss and the order within a gradient step are not here: they are the algorithm, and stand in
its file (what DDPGLag and TD3Lag share in `deterministic`).
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import torch
from torch import Tensor

from thalweg.algos.common.adam import Adam
from thalweg.algos.common.cuda_graphs import CudaGraphs
from thalweg.algos.common.errors import AlgorithmError
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
from thalweg.algos.offpolicy.critics import Critics, TargetNetworks
from thalweg.algos.offpolicy.mean_metrics import MeanMetrics
from thalweg.algos.offpolicy.replay_buffer import Batch, ReplayBuffer, valid_transitions
from thalweg.algos.offpolicy.value_scale import ValueScale
from thalweg.algos.policy.actions import Actions
from thalweg.algos.policy.mlp import StackedMLP
from thalweg.algos.policy.normaliser import Normaliser
from thalweg.algos.policy.policy import Policy
from thalweg.algos.policy.policy_file import About
from thalweg.core.config import to_plain

CRITICS, POLICY = 0, 1
"""Groups of metrics."""
ROUNDING = 1e-9
"""Tolerance for gradient steps that are due but for rounding."""


class AgentSpec(NamedTuple):
    """Algorithm-specific properties of an agent's networks."""

    algorithm: str
    """Name in the registry."""
    actions: Actions
    """How the policy represents the action space."""
    action_width: int
    """W, numbers of an encoded action in the replay buffer."""
    reward_critics: int
    """Number of critics of the reward."""
    critic_outputs: int = 0
    """Outputs of a critic for an observation; 0: one output for an observation and an action."""
    greedy: bool = False
    """Whether the policy takes its most probable action."""
    temperature: float = 1.0
    """Temperature at which the policy's options are sampled."""
    policy_metrics: tuple[str, ...] = ()
    """Names of metrics that each update of the policy adds to `policy_loss`."""


class Agent:
    """Policy, critics, target networks and replay buffer, with the random generator that all of them share."""

    def __init__(self, spec: AgentSpec, config: OffPolicyConfig, task: Task) -> None:
        self.config, self.num_envs = config, task.num_envs
        self.generator = new_generator(task.device, task.seed)
        size, costs = config.frame_stack * task.obs_size, len(config.limits)
        self.critic_size = task.critic_size if config.asymmetric_critics else 0
        """C, how many numbers critics see beside the observation."""
        seen = size + self.critic_size
        self.policy = Policy(
            task.obs_size,
            spec.actions,
            config.shape,
            frames=config.frame_stack,
            normalise=config.normalise_observations,
            greedy=spec.greedy,
            temperature=spec.temperature,
            generator=self.generator,
            about=About(spec.algorithm, to_plain(config), task.context),
        )
        self.critics = Critics(
            spec.reward_critics,
            costs,
            config.cost_critics,
            inputs=seen if spec.critic_outputs else seen + spec.action_width,
            outputs=spec.critic_outputs or 1,
            shape=config.shape,
            generator=self.generator,
        )
        self.targets = TargetNetworks([self.policy.actor.stack, self.critics.stack])
        self.policy_optimiser = Adam([self.policy.actor.stack.flat], config.learning_rate)
        self.critic_optimiser = Adam([self.critics.stack.flat], config.critic_learning_rate)
        self.multipliers = Multipliers(config, config.limits)
        self.replay = ReplayBuffer(
            config.replay_size, size, spec.action_width, costs, critic_obs=self.critic_size, device=task.device
        )
        self.critic_normaliser = Normaliser(self.critic_size, config.normalise_observations, task.device)
        """Of the C numbers, which are not stacked."""
        self._cost_normaliser = Normaliser(costs, config.normalise_cost, task.device)
        self.scale = ValueScale(config, costs, task.num_envs, task.device)
        discounts = [[config.discount], *[[config.cost_discount]] * costs]
        self._discounts = torch.tensor(discounts, dtype=torch.float32, device=task.device)
        names = ["", *(f"cost{name}_" for name in cost_suffixes(costs))]
        self._value_names = [f"{name}q_mean" for name in names]
        self._last_values = [math.nan] * len(names)
        """Mean values in the last report [S]."""
        self._metrics = MeanMetrics(
            (*(f"{name}q_loss" for name in names), *self._value_names),
            ("policy_loss", *spec.policy_metrics),
            device=task.device,
        )
        self._graphs = CudaGraphs(task.graphs, [self.generator])
        self.steps, self.gradient_steps, self.progress = 0, 0, 0.0
        """`progress`: share of the run at the last call of `learn`."""
        self._updates_due, self._reported_at = 0.0, 0
        self._policy_given = False

    @property
    def rollout_steps(self) -> int:
        """T: steps of each environment between two rounds of learning."""
        return self.config.rollout_steps(self.num_envs)

    @property
    def target_actor(self) -> StackedMLP:
        """The policy's target network."""
        return self.targets.copies[0]

    @property
    def target_critics(self) -> StackedMLP:
        """The critics' target networks."""
        return self.targets.copies[1]

    @property
    def acts_randomly(self) -> bool:
        """Whether actions are still uniformly random; a policy that was given acts from the first step."""
        return self.steps < self.config.random_steps and not self._policy_given

    @property
    def critics_warm_up(self) -> bool:
        """Whether only the critics and their target networks learn, because the policy was given."""
        return self.steps < self._warmup_end

    @property
    def _warmup_end(self) -> int:
        return self.config.warmup_steps if self._policy_given else 0

    def warm_up_critics(self) -> None:
        """Let the policy, which was given, act from the first step, and only the critics learn at first.

        After `random_steps` without learning, which fill the replay buffer, the policy, the multipliers and α stay
        during `critic_warmup_steps`. The critics' weights of numbers that the policy's statistics never saw vary are
        set to 0, as are the policy's (`Policy.initialise_from`). To be called before the first step; a restored state
        has its own count.
        """
        self._policy_given = True
        self.critics.stack.clear_inputs(self.policy.normaliser.ignored)

    def action_parameters(self, obs: Tensor) -> Tensor:
        """Return the policy's outputs [N, P] at observations float32 [N, K * D]."""
        return self.policy.actor(self.policy.normaliser(obs))

    def store(self, rollout: Rollout, encode: Callable[[Tensor], Tensor]) -> None:
        """Store the rollout's valid steps; `encode` maps their raw actions [S, A] to [S, W].

        Raises `NotFiniteError` for NaN or infinity, and `AlgorithmError` for a negative cost with `cost_floor`.
        """
        steps = valid_transitions(rollout, self.critic_size)
        costs = steps.signals[:, 1:]
        negative = costs[costs < 0.0]
        if self.config.cost_floor and len(negative):
            raise AlgorithmError(f"a step cost {negative[0]:g}; with cost_floor none may be negative: set it to false")
        if not self.critics_warm_up:
            self.policy.normaliser.update(steps.obs)
        if self.critic_size:
            self.critic_normaliser.update(steps.critic_obs)
        self._cost_normaliser.update(costs)
        signals = torch.cat([steps.signals[:, :1], self._cost_normaliser(costs)], 1)
        self.replay.add(steps._replace(actions=encode(steps.actions), signals=signals))
        self.scale.update(rollout, self._cost_normaliser(rollout.costs))
        count = len(steps.obs)
        self.steps += count
        # The first steps earn no gradient steps, and none are made up for them later.
        self._updates_due += self.config.updates_per_step * max(0, min(count, self.steps - self.config.random_steps))

    def learn(self, feedback: Feedback, step: Callable[[Batch], None]) -> None:
        """Call `step` with a new batch for each gradient step that is due.

        Raises `NotFiniteError` for a metric that is NaN or infinite afterwards.
        """
        self.progress = feedback.progress
        rate = self.config.learning_rate * (1.0 - feedback.progress if self.config.linear_decay else 1.0)
        self.policy_optimiser.rate = rate
        if not self.gradient_steps:
            self.targets.hard_update()  # the policy's weights may have been loaded since the copies were made
        count = int(self._updates_due + ROUNDING)
        self._updates_due -= count
        normalisers = self.policy.normaliser, self.critic_normaliser
        for rows in self.replay.batches(count, self.config.minibatch, self.generator, *normalisers):
            updates_policy, updates_targets = self.updates_policy, self._updates_targets
            # The recorded graph depends on what changes its operations: the policy's turn and the multipliers.
            kind = updates_policy, updates_targets
            self._graphs.run(lambda rows: self._take(step, rows), rows, kind, self.multipliers.values)
            self._metrics.count(CRITICS)
            if updates_policy:
                self._metrics.count(POLICY)
            self.gradient_steps += 1
            if self.config.multiplier_schedule == "gradient_step" and not self.critics_warm_up:
                self.multipliers.update(feedback, self.config.current_limits(feedback))
        self._metrics.require_finite()

    def _take(self, step: Callable[[Batch], None], rows: Tensor) -> None:
        """Take a gradient step on rows of the replay buffer."""
        step(self.replay.batch(rows))
        if self._updates_targets and not self.updates_policy:
            self.targets.soft_update(self.config.target_rate)  # the target policy equals the policy, and stays

    @property
    def updates_policy(self) -> bool:
        """Whether the current gradient step updates the policy too."""
        return self._updates_targets and not self.critics_warm_up

    @property
    def _updates_targets(self) -> bool:
        """Whether the current gradient step moves the target networks, with the policy or while it waits."""
        return (self.gradient_steps + 1) % self.config.policy_delay == 0

    @torch.no_grad()
    def update_critics(
        self,
        q_values: Tensor,
        backward: Callable[[Tensor], None],
        batch: Batch,
        next_values: Tensor,
        chosen: Tensor | None = None,
        *,
        slack: tuple[float | Tensor, float | Tensor] = (0.0, 0.0),
    ) -> None:
        """Take one step of Adam of all critics on ½ E[(Q - y)²], summed over critics (`maths.advantages`).

        Rewards and costs are in the units of `scale`, and targets within its bounds.

        Args:
            q_values: [K, B, W], outputs of the critics.
            backward: Backward function that their stack's `forward_and_backward` returned beside them.
            batch: The stored steps.
            next_values: V(s') [S, B], before the cost floor.
            chosen: Index [B] int64 of the output for the batch's actions; None with a single output.
            slack: How far the reward's targets may lie below and above the bounds, see `ValueScale.bounded`.
        """
        if self.config.cost_floor:
            next_values = torch.cat([next_values[:1], next_values[1:].clamp(min=0.0)])
        index = None if chosen is None else chosen.expand(len(q_values), -1).unsqueeze(-1)
        values = (q_values if index is None else q_values.gather(-1, index)).squeeze(-1)
        signals = self.scale.scaled(batch.signals)
        targets = advantages.td_target(signals, batch.continues, next_values, self._discounts)
        targets = self.scale.bounded(targets, *slack)[self.critics.signal]
        grads = losses.squared_error_grad(values, targets).unsqueeze(-1)
        backward(grads if index is None else torch.zeros_like(q_values).scatter_(-1, index, grads))
        self.critic_optimiser.step(self.config.max_grad_norm)
        errors, one_per_signal = losses.squared_error(values, targets), self.critics.one_per_signal
        means = values[one_per_signal].mean(-1) * self.scale.units[:, 0]
        self._metrics.add(CRITICS, torch.cat([errors[one_per_signal], means]))

    def update_policy(self, loss: Tensor, *metrics: Tensor) -> None:
        """Take one step of Adam of the policy with the gradient of this scalar loss, which its parameters hold; then
        move all target networks."""
        self.policy_optimiser.step(self.config.max_grad_norm)
        self.targets.soft_update(self.config.target_rate)
        self._metrics.add(POLICY, torch.stack([loss, *metrics]).detach())

    def report(self, feedback: Feedback) -> dict[str, float]:
        """Update the multipliers and return the metrics, if a report is due; else an empty dictionary."""
        if self.steps - self._reported_at < self.config.steps_per_update and feedback.steps_left:
            return {}
        self._reported_at = self.steps
        if self.config.multiplier_schedule == "report" and self.gradient_steps and not self.critics_warm_up:
            self.multipliers.update(feedback, self.config.current_limits(feedback))
        means = self._metrics.report()
        self._last_values = [means[name] for name in self._value_names]
        return (
            means
            | {
                "gradient_steps": self.gradient_steps,
                "replay": self.replay.filled,
                "learning_rate": self.policy_optimiser.rate,
            }
            | self.scale.metrics()
            | self.multipliers.metrics(feedback, self._multiplier_updates_left(feedback))
            | cost_metrics(
                feedback,
                self.config.current_limits(feedback),
                self.config.cost_means(feedback),
            )
        )

    def warnings(self, feedback: Feedback, above: float = 0.0) -> dict[str, str]:
        """Return warnings, by a short code, about limits, multipliers and steps without effect and impossible values.

        `above`, in the critics' units, is what values of the reward contain at most beside rewards.
        """
        too_slow = self.multipliers.warnings(feedback, self._multiplier_updates_left(feedback))
        impossible = self.scale.warnings(self._last_values, feedback, above * float(self.scale.units[0, 0]))
        return limit_warnings(self.config, feedback) | too_slow | impossible | self._warmup_warnings(feedback)

    def state(self) -> dict[str, Any]:
        """Return everything that resuming needs, as nested dictionaries of arrays and plain data."""
        return {
            "actor": module_state(self.policy.actor),
            "critics": module_state(self.critics.stack),
            "slow": array_of(self.targets.target),
            "policy_optimiser": self.policy_optimiser.state(),
            "critic_optimiser": self.critic_optimiser.state(),
            "multipliers": self.multipliers.state(),
            "normaliser": self.policy.normaliser.state(),
            "costs_seen": self._cost_normaliser.state(),
            "returns_seen": self.scale.state(),
            "replay": self.replay.state(),
            "generator": generator_state(self.generator),
            "tally": self._metrics.state(),
            "steps": self.steps,
            "gradient_steps": self.gradient_steps,
            "progress": self.progress,
            "owed": self._updates_due,
            "reported_at": self._reported_at,
            **({"critic_normaliser": self.critic_normaliser.state()} if self.critic_size else {}),
            **({"policy_given": True} if self._policy_given else {}),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned; further keys are ignored."""
        load_module(self.policy.actor, state["actor"])
        load_module(self.critics.stack, state["critics"])
        self.targets.target.copy_(tensor_of(state["slow"], CPU))
        self.policy_optimiser.load_state(state["policy_optimiser"])
        self.critic_optimiser.load_state(state["critic_optimiser"])
        self.multipliers.load_state(state["multipliers"])
        self.policy.normaliser.load_state(state["normaliser"])
        self._cost_normaliser.load_state(state["costs_seen"])
        self.scale.load_state(state["returns_seen"])
        if self.critic_size:
            self.critic_normaliser.load_state(state["critic_normaliser"])
        self.replay.load_state(state["replay"])
        load_generator(self.generator, state["generator"])
        self._metrics.load_state(state["tally"])
        self.steps, self.gradient_steps = int(state["steps"]), int(state["gradient_steps"])
        self.progress = float(state["progress"])
        self._updates_due, self._reported_at = float(state["owed"]), int(state["reported_at"])
        self._policy_given = bool(state.get("policy_given", False))

    def _warmup_warnings(self, feedback: Feedback) -> dict[str, str]:
        """Return a warning, by a short code, if the run ends before the policy that was given begins to learn."""
        end, last = self._warmup_end, self.steps + feedback.steps_left
        if not self._policy_given or end < last:
            return {}
        sentence = (
            f"the critics warm up for the first {end:,} steps (random_steps + critic_warmup_steps), but the run has"
            f" {last:,}: the policy stays what it began with; take more steps, or lower critic_warmup_steps"
        )
        return {"policy_never_learns": sentence}

    def _multiplier_updates_left(self, feedback: Feedback) -> int:
        """Return the number of updates of the multipliers in the rest of the run."""
        first = max(self.config.random_steps, self._warmup_end)
        steps = max(feedback.steps_left - max(first - self.steps, 0), 0)
        if self.config.multiplier_schedule == "gradient_step":
            return int(steps * self.config.updates_per_step)
        return math.ceil(steps / self.config.steps_per_update)
