"""Agent of planners: acts, stores transitions, fits the model, and saves its state.

How candidates are weighted and what the critics minimise is defined in each algorithm's own file.
"""

import math
from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor

from thalweg.algos.common.errors import require_finite
from thalweg.algos.common.return_statistics import ReturnStatistics
from thalweg.algos.common.state import generator_state, load_generator, load_module, module_state, new_generator
from thalweg.algos.common.value_bounds import impossible_values
from thalweg.algos.constraint.cost_limits import ENOUGH_EPISODES, cost_metrics, cost_suffixes, limit_warnings
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.planning.config import PlanningConfig
from thalweg.algos.planning.ending_costs import EndingCosts
from thalweg.algos.planning.episode_length import EpisodeLength
from thalweg.algos.planning.model.ensemble import HEADS
from thalweg.algos.planning.model.fitting import Fitter
from thalweg.algos.planning.model.transitions import Batch, ReplayBuffer, TransitionBuilder
from thalweg.algos.planning.planner import Decision
from thalweg.algos.planning.policy import PlannerPlayer, PlannerPolicy
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.policy_file import About
from thalweg.core.config import to_plain


class Agent:
    """Planning policy, replay buffer and the fitting of the model, with the metrics of all three."""

    def __init__(self, algorithm: str, config: PlanningConfig, task: Task, logged: tuple[str, ...] = ()) -> None:
        """`logged` names the metrics that the algorithm passes to `log`."""
        self.config, self.num_envs, self._logged = config, task.num_envs, logged
        self.generator = new_generator(task.device, task.seed)
        self.policy = PlannerPolicy(
            task.obs_size,
            actions_of(task.action_space, config.adapter, "squashed"),
            config,
            About(algorithm, to_plain(config), task.context),
            self.generator,
        )
        self.policy.limits = config.limits_at(0.0)
        self.replay = ReplayBuffer(config.replay_size, config.hold_out, task.device)
        self.fitter = Fitter(self.policy.ensemble, config, self.generator)
        self.lengths = EpisodeLength(task.num_envs, config.episode_length)
        self.ending_costs = EndingCosts(len(config.limits))
        # A discount of the critics is that of a decision, which lasts `action_repeat` steps.
        self.returns = ReturnStatistics(task.num_envs, (config.discount ** (1.0 / config.action_repeat),))
        self._player = PlannerPlayer(
            self.policy, task.num_envs, self.generator, stacked=True, exploration=config.exploration
        )
        self._builder = TransitionBuilder(
            task.num_envs, config.action_repeat, drop_terminal=config.drop_terminal, device=task.device
        )
        self._steps, self._reported_at = 0, 0
        self._metrics = PlannerMetrics()
        self._last_value = math.nan

    @property
    def rollout_steps(self) -> int:
        """T, steps of each environment between two fits of the model."""
        return self.config.rollout_steps(self.num_envs)

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Return raw actions [N, A] for observations float32 [N, K * D]: random during `random_steps`, then planned."""
        raw, decision = self._player.raw(obs, fresh, at_random=self._steps < self.config.random_steps)
        if decision is not None:
            self._metrics.add_decision(decision)
        return raw

    def learn(self, rollout: Rollout) -> None:
        """Store the rollout's transitions and fit the model; raises `NotFiniteError` for a NaN in them or a loss."""
        planned = self._steps >= self.config.random_steps
        self._steps += int(rollout.valid.sum())
        self.lengths.update(rollout)
        self.ending_costs.update(rollout)
        masks = (rollout.fresh[:-1], rollout.terminated, rollout.truncated, rollout.valid)
        self.returns.update(rollout.rewards.unsqueeze(-1).cpu().numpy(), *(mask.cpu().numpy() for mask in masks))
        batch = self._builder.transitions(rollout, self.policy.obs_size)
        if len(batch.rewards):
            require_finite(sum_of_rewards_and_costs=float(batch.rewards.sum() + batch.costs.sum()))
            if planned and self.replay.size:
                self._metrics.add_model_error(self.policy, batch)
            self.policy.ensemble.update_statistics(batch)
            self.replay.add(batch)
        losses = self.fitter.fit(self.replay, int(rollout.valid.sum()))
        if losses is not None:
            self._metrics.add({f"model_{name}_loss": loss for name, loss in zip(HEADS, losses, strict=True)})
            self._metrics.require_finite()
        self._set_budget()
        self.policy.refresh()

    def _set_budget(self) -> None:
        """Set what the budgets of plans depend on beside the limits."""
        self.policy.episode_length = self.lengths.mean
        self.policy.ending_shares = self.ending_costs.shares

    def critic_batches(self) -> Iterator[Batch]:
        """Yield the batches that the critics learn from after a rollout.

        Raises `NotFiniteError` after the last batch if a logged metric has been NaN or infinite.
        """
        waits = self.config.critics_wait and self._steps < self.config.random_steps
        if self.replay.size and not waits:
            for _ in range(self.config.critic_steps):
                yield self.replay.rows(self.replay.sample_indices((self.config.minibatch,), self.generator))
            self._metrics.require_finite()

    def bounded(
        self, values: Tensor, unit: Tensor | float, below: float | Tensor = 0.0, above: float | Tensor = 0.0
    ) -> Tensor:
        """Return the values that the critics' targets add to a reward, in units of `unit`, clipped to what an episode
        can pay.

        `below` and `above` widen the bounds, in these units, for what a value contains beside rewards.
        """
        low, high = self.value_bounds()
        if not self.config.bound_targets or not (math.isfinite(low) and math.isfinite(high)):
            return values
        least, most = (
            torch.as_tensor(bound, dtype=values.dtype, device=values.device)
            for bound in (low / unit - below, high / unit + above)
        )
        return values.clamp(least, most)

    def value_bounds(self) -> tuple[float, float]:
        """Return the smallest and the largest discounted return from a step on, in the task's units: those of the
        settings, or learnt ones, which are infinite before any episode has finished."""
        if self.config.return_bounds:
            low, high = self.config.return_bounds
            return low, high
        low, high = self.returns.bounds(self.config.bound_margin)
        return float(low[0]), float(high[0])

    def log(self, **numbers: Tensor) -> None:
        """Add metrics whose means the next report contains."""
        self._metrics.add(numbers)

    def report(self, feedback: Feedback) -> dict[str, float]:
        """Return the metrics since the last report, or an empty dictionary when no report is due.

        The decisions that follow have the limits of this moment.
        """
        self.policy.limits = self.config.current_limits(feedback)
        if self._steps - self._reported_at < self.config.steps_per_update and feedback.steps_left > 0:
            return {}
        self._reported_at = self._steps
        budget = self.policy.budget.costs
        budgets = {f"budget{name}": float(b) for name, b in zip(cost_suffixes(len(budget)), budget, strict=True)}
        held_out = {}
        if self.replay.size:
            errors = self.fitter.held_out(self.replay).mean(-1)
            held_out = {f"held_out_{name}_loss": float(e) for name, e in zip(HEADS, errors, strict=True)}
        sizes = {"replay_size": float(self.replay.size), "episode_length": self.lengths.mean}
        metrics = self._nan_metrics() | self._metrics.means() | held_out | budgets | sizes
        self._metrics.clear()
        self._last_value = metrics.get("value", math.nan)
        return metrics | cost_metrics(feedback, self.policy.limits)

    def warnings(self, feedback: Feedback, unit: float, below: float = 0.0, above: float = 0.0) -> dict[str, str]:
        """Return warnings, by a short code, about cost limits and about a mean value that no episode can pay.

        Values are in units of `unit`; `below` and `above`, in these units, widen the bounds as those of `bounded` do.
        """
        found = limit_warnings(self.config, feedback)
        if feedback.episodes < ENOUGH_EPISODES:
            return found
        low, high = self.value_bounds()
        given = "correct return_bounds" if self.config.return_bounds else "set return_bounds"
        bounded = given if self.config.bound_targets else "set bound_targets"
        remedy = f"lower critic_learning_rate or target_rate, or {bounded}"
        mean, least, most = self._last_value * unit, low - below * unit, high + above * unit
        return found | impossible_values(["reward"], [mean], [least], [most], remedy)

    def _nan_metrics(self) -> dict[str, float]:
        """Return NaN for each metric that may have no value yet, so that every report has the same names."""
        costs = [f"cost{name}" for name in cost_suffixes(len(self.config.limits))]
        names = [f"model_{name}_loss" for name in HEADS] + ["plan_reward", *(f"plan_{cost}" for cost in costs)]
        names += [f"{prefix}_{head}" for head in ("reward", *costs, "end") for prefix in ("predicted", "realised")]
        names += ["feasible_share", "state_error", *(f"held_out_{name}_loss" for name in HEADS), *self._logged]
        return dict.fromkeys(names, float("nan"))

    def state(self) -> dict[str, Any]:
        """Return the complete state as nested dictionaries of arrays and plain data."""
        return {
            "ensemble": self.policy.ensemble.state(),
            "method": module_state(self.policy.method.modules),
            "fitter": self.fitter.state(),
            "replay": self.replay.state(),
            "assembly": self._builder.state(),
            "lengths": self.lengths.state(),
            "ending_costs": self.ending_costs.state(),
            "returns": self.returns.state(),
            "player": self._player.state(),
            "generator": generator_state(self.generator),
            "tally": self._metrics.state(),
            "steps": self._steps,
            "reported_at": self._reported_at,
            "limits": list(self.policy.limits),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned; unknown keys are ignored."""
        self.policy.ensemble.load_state(state["ensemble"])
        load_module(self.policy.method.modules, state["method"])
        self.fitter.load_state(state["fitter"])
        self.replay.load_state(state["replay"])
        self._builder.load_state(state["assembly"])
        self.lengths.load_state(state["lengths"])
        self.returns.load_state(state["returns"])
        self._player.load_state(state["player"])
        load_generator(self.generator, state["generator"])
        self._metrics.load_state(state["tally"], self.policy.device)
        self._steps, self._reported_at = int(state["steps"]), int(state["reported_at"])
        self.ending_costs.load_state(state["ending_costs"])
        self._set_budget()
        self.policy.limits = tuple(state.get("limits", self.config.limits))
        self.policy.refresh()


class PlannerMetrics:
    """Running means of a planner's metrics; their sums stay on the device, so that adding needs no synchronisation."""

    def __init__(self) -> None:
        self._sums: dict[str, Tensor] = {}
        self._counts: dict[str, float] = {}

    def add(self, numbers: dict[str, Tensor], weight: float = 1.0) -> None:
        """Add scalars [], each the mean of `weight` values."""
        for name, number in numbers.items():
            share = number.detach().double() * weight
            self._sums[name] = self._sums[name] + share if name in self._sums else share
            self._counts[name] = self._counts.get(name, 0.0) + weight

    def require_finite(self) -> None:
        """Raise `NotFiniteError` if a metric has been NaN or infinite since the last report."""
        require_finite(**self._totals())

    def add_decision(self, decision: Decision) -> None:
        """Add the reward, cost and feasible share that the planner expects of its decisions."""
        names = cost_suffixes(decision.cost.shape[1])
        costs = {f"plan_cost{name}": cost for name, cost in zip(names, decision.cost.mean(0), strict=True)}
        numbers = {"plan_reward": decision.reward.mean(), "feasible_share": decision.feasible.mean()}
        self.add(costs | numbers, len(decision.reward))

    def add_model_error(self, policy: PlannerPolicy, batch: Batch) -> None:
        """Add the model's predictions for transitions it has not been fitted to, beside their true values."""
        names = cost_suffixes(batch.costs.shape[1])
        expected, error = policy.ensemble.expected(batch)
        realised = torch.cat([batch.rewards.unsqueeze(-1), batch.costs, batch.terminated.unsqueeze(-1)], -1).mean(0)
        heads = ["reward", *(f"cost{name}" for name in names), "end"]
        numbers = {f"predicted_{head}": number for head, number in zip(heads, expected, strict=True)}
        numbers |= {f"realised_{head}": number for head, number in zip(heads, realised, strict=True)}
        self.add(numbers, len(batch.rewards))
        continuing = int((~batch.terminated).sum())
        if continuing:
            self.add({"state_error": error}, continuing)

    def means(self) -> dict[str, float]:
        """Return the mean of each metric since the last `clear`."""
        return {name: total / self._counts[name] for name, total in self._totals().items()}

    def clear(self) -> None:
        self._sums.clear()
        self._counts.clear()

    def state(self) -> dict[str, Any]:
        """Return the sums and counts as plain data."""
        return {"sums": self._totals(), "counts": dict(self._counts)}

    def load_state(self, state: dict[str, Any], device: torch.device) -> None:
        """Restore what `state` returned."""
        self._counts = dict(state["counts"])
        self._sums = {
            name: torch.tensor(total, dtype=torch.float64, device=device) for name, total in state["sums"].items()
        }

    def _totals(self) -> dict[str, float]:
        """Return the sums, copied from the device in one transfer."""
        totals = torch.stack(list(self._sums.values())).tolist() if self._sums else []
        return dict(zip(self._sums, totals, strict=True))
