"""What do on-policy algorithms do alike? Act, turn a rollout into samples, take one step along a gradient, see how far
the policy has moved, and be put away and brought back.

Losses, updates and the minibatch loop are absent on purpose: they are the algorithm, and stand in its file.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, cast

import torch
from torch import Tensor

from thalweg.algos.common.adam import Adam
from thalweg.algos.common.errors import require_finite
from thalweg.algos.common.settings import as_data
from thalweg.algos.common.state import (
    generator_state,
    load_generator,
    load_module,
    module_state,
    new_generator,
)
from thalweg.algos.constraint.cost_limits import cost_suffixes
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.maths import losses
from thalweg.algos.maths.advantages import centred, standardised
from thalweg.algos.onpolicy.config import ConstrainedConfig, FirstOrderConfig, OnPolicyConfig
from thalweg.algos.onpolicy.rollout_samples import RolloutMemory, Samples, Signal, samples_of, valid_obs
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.distributions import AnalyticDistribution, TapedDistribution
from thalweg.algos.policy.memory import Sequences
from thalweg.algos.policy.networks import Critics
from thalweg.algos.policy.policy import About, NetworkPlayer, Policy


class Agent:
    """A policy, K critics that share no weights with it, Adam, and where all that is random comes from."""

    def __init__(self, algorithm: str, critics: int, config: OnPolicyConfig, task: Task) -> None:
        self.config = config
        self.generator = new_generator(task.device, task.seed)
        self.policy = Policy(
            task.obs_size,
            actions_of(task.action_space, config.adapter),
            config.shape,
            frames=config.frame_stack,
            normalise=config.normalise_observations,
            generator=self.generator,
            about=About(algorithm, as_data(config), task.context),
        )
        self.critics = Critics(critics, config.frame_stack * task.obs_size, config.shape, self.generator)
        rate = config.learning_rate if isinstance(config, FirstOrderConfig) else 0.0
        self.policy_optimiser = Adam(self.policy.actor.parameters(), rate)
        self.critic_optimiser = Adam(self.critics.parameters(), config.critic_learning_rate)
        drawn = torch.randint(2**62, (), generator=self.generator, device=task.device)
        self._critic_generator = new_generator(task.device, int(drawn))
        self._critic_log: list[Tensor] = []
        self._beside = ThreadPoolExecutor(1, "critics")
        self._player = NetworkPlayer(self.policy, task.num_envs, False, self.generator, stacked=True)
        self._memory: RolloutMemory | None = None
        if self.policy.actor.gru is not None and self.critics.gru is not None:
            self._memory = RolloutMemory(self.policy.actor.gru, self.critics.gru, task.num_envs, config.sequence)

    @property
    def rollout_steps(self) -> int:
        """T: steps of each environment between updates."""
        return max(2, self.config.steps_per_update // self._player.num_envs)

    @contextmanager
    def critics_learning(self, samples: Samples, passes: int = 1) -> Iterator[None]:
        """While the body runs, the critics go through the samples so often.

        They share no weights with the policy, and the advantages are known already, so that neither has to wait for the
        other; the numbers are those of one after the other, which is how it is done where no compiled loop leaves
        Python to the policy meanwhile.
        """
        if self.critics.in_loops:
            going = self._beside.submit(self._learn_critics, samples, passes)
            try:
                yield
            finally:
                self._critic_log += going.result()
        else:
            yield
            self._critic_log += self._learn_critics(samples, passes)

    def critic_losses(self) -> Tensor:
        """[K] ½ E[(V - target)²] of each critic, mean over the gradient steps since they were last asked for."""
        means = torch.stack(self._critic_log).mean(0)
        self._critic_log = []
        return means

    def _learn_critics(self, samples: Samples, passes: int) -> list[Tensor]:
        """The losses [K] of each gradient step."""
        config, generator, targets = self.config, self._critic_generator, samples.targets.T
        if isinstance(samples.inputs, Tensor) and self.critics.in_loops:
            return [
                error
                for _ in range(passes)
                for error in self.critics.fit_epoch(
                    *samples.shuffled((targets,), generator),
                    minibatch=config.minibatch,
                    optimiser=self.critic_optimiser,
                    decay=config.critic_decay,
                    most=config.max_grad_norm,
                )
            ]
        found = []
        for _ in range(passes):
            for inputs, (aims,) in samples.minibatches((targets,), config.minibatch, generator):
                found.append(self.critics.regress(inputs, aims.T, config.critic_decay))
                self.critic_optimiser.step(config.max_grad_norm)
        return found

    def updates_left(self, feedback: Feedback) -> int:
        """Updates still to come after this one."""
        return math.ceil(feedback.steps_left / (self.rollout_steps * self._player.num_envs))

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Raw actions [N, A] drawn from the policy, for observations float32 [N, K * D]."""
        return self._player.raw(obs, fresh)

    def samples(self, rollout: Rollout, signals: Sequence[Signal]) -> Samples:
        """The rollout's valid steps with the advantages of each signal, critic k predicting signal k; afterwards the
        rollout counts among the statistics of observations.

        Those statistics change here only, so that the policy that acted is the one learnt from. A fresh policy with
        an orthogonal start and bounded activations draws alike whatever it sees, so the first rollout's are taken in
        at once.
        """
        normaliser, config = self.policy.normaliser, self.config
        fresh = normaliser.count == 0 and config.initial == "orthogonal" and config.activation == "tanh"
        if fresh:
            normaliser.update(valid_obs(rollout))
        samples = samples_of(rollout, self.critics, normaliser, signals, self._memory)
        if not fresh:
            normaliser.update(valid_obs(rollout))
        if self._memory is not None:
            self._memory.move_on()
            # Not the same yet after the first rollout, which acting saw without statistics.
            self._player.hidden = self._memory.starts["actor"]
        return samples

    def decay(self, progress: float) -> float:
        """Set the policy's learning rate for this share of the run, 0..1, if it is to fall; returns it."""
        assert isinstance(self.config, FirstOrderConfig)
        rate = self.config.learning_rate * (1.0 - progress if self.config.linear_decay else 1.0)
        self.policy_optimiser.rate = rate
        return rate

    def step(self, inputs: Tensor | Sequences, loss_of: Callable[[TapedDistribution], Tensor]) -> Tensor:
        """One step of Adam of the policy down the gradient of a scalar, which is returned without it: the loss of what
        the policy is at B states, given what it sees there."""
        parameters, back = self.policy.actor.forward_and_backward(inputs)
        new = TapedDistribution(cast(AnalyticDistribution, self.policy.actions.distribution(parameters)))
        loss = loss_of(new)
        loss.backward()
        back(new.slope())
        self.policy_optimiser.step(self.config.max_grad_norm)
        return loss.detach()

    def state(self) -> dict[str, Any]:
        """Everything, as nested dictionaries of arrays and plain data."""
        state = {
            "actor": module_state(self.policy.actor),
            "critics": module_state(self.critics),
            "normaliser": self.policy.normaliser.state(),
            "policy_optimiser": self.policy_optimiser.state(),
            "critic_optimiser": self.critic_optimiser.state(),
            "generator": generator_state(self.generator),
            "critic_generator": generator_state(self._critic_generator),
            "player": self._player.state(),
        }
        return state if self._memory is None else state | {"memory": self._memory.state()}

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`; further keys are not looked at."""
        load_module(self.policy.actor, state["actor"])
        load_module(self.critics, state["critics"])
        self.policy.normaliser.load_state(state["normaliser"])
        self.policy_optimiser.load_state(state["policy_optimiser"])
        self.critic_optimiser.load_state(state["critic_optimiser"])
        load_generator(self.generator, state["generator"])
        load_generator(self._critic_generator, state["critic_generator"])
        self._player.load_state(state["player"])
        if self._memory is not None:
            self._memory.load_state(state["memory"])


class KLMonitor:
    """How far the policy has moved from the one that acted, measured after each pass."""

    def __init__(self, agent: Agent, samples: Samples, *, new_first: bool = False) -> None:
        """`new_first`: KL(π_θ ‖ π_k) instead of KL(π_k ‖ π_θ)."""
        self._agent, self._samples, self._new_first = agent, samples, new_first
        with torch.no_grad():
            self.old_parameters = agent.policy.actor.everywhere(samples.inputs)
            """[B, P] of π_k."""
            self._old = agent.policy.actions.distribution(self.old_parameters)
            self.old_log_prob = self._old.log_prob(samples.actions)
            """[B]."""
        self.passes, self.kl, self.entropy = 0, 0.0, 0.0
        self.kl_per_state = torch.zeros_like(self.old_log_prob)
        """[B] KL of each state, in nats."""
        self.log_prob = self.old_log_prob
        """[B] log π_θ(a|s)."""

    @torch.no_grad()
    def measure(self) -> None:
        """After a pass; raises `NotFiniteError` if the policy has become NaN."""
        policy = self._agent.policy
        new = policy.actions.distribution(policy.actor.everywhere(self._samples.inputs))
        self.kl_per_state = new.kl(self._old) if self._new_first else self._old.kl(new)
        self.log_prob = new.log_prob(self._samples.actions)
        self.kl, self.entropy = float(self.kl_per_state.mean()), float(new.entropy().mean())
        self.passes += 1
        require_finite(kl=self.kl, entropy=self.entropy)

    @property
    def ratio(self) -> Tensor:
        """[B] π_θ(a|s) / π_k(a|s)."""
        return (self.log_prob - self.old_log_prob).exp()

    def clip_fraction(self, clip: float) -> float:
        """Share of states whose ratio is outside 1 ± ε."""
        return float(((self.ratio - 1.0).abs() > clip).float().mean())

    @property
    def may_continue(self) -> bool:
        """Whether there may be another pass."""
        config = self._agent.config
        assert isinstance(config, FirstOrderConfig)
        return self.passes < config.passes and self.kl <= config.target_kl


def reward_signal(config: OnPolicyConfig, rollout: Rollout) -> Signal:
    """What the first critic predicts."""
    return Signal(rollout.rewards, config.discount, config.trace)


def cost_signals(config: ConstrainedConfig, rollout: Rollout) -> list[Signal]:
    """What the other critics predict: each cost."""
    return [Signal(cost, config.cost_discount, config.cost_trace) for cost in rollout.costs.unbind(-1)]


def cost_advantages(config: ConstrainedConfig, samples: Samples) -> Tensor:
    """A_c [M, B], centred, and divided by their deviations if the config says so."""
    scaled = standardised if config.standardise_cost else centred
    return torch.stack([scaled(advantages) for advantages in samples.advantages[1:]])


def metrics_of(agent: Agent, samples: Samples, log: Sequence[Tensor], monitor: KLMonitor) -> dict[str, float]:
    """What every update reports: mean losses of its gradient steps (the policy's are in the log), how well the critics
    predicted, and how far the policy moved. Raises `NotFiniteError` if a loss is NaN."""
    errors = agent.critic_losses().tolist()
    found = {"policy_loss": float(torch.stack(list(log)).mean())}
    found |= {f"{name}value_loss": error for name, error in zip(_critic_names(len(errors)), errors, strict=True)}
    require_finite(**found)
    explained = {
        f"{name}explained_variance": losses.explained_variance(values, targets)
        for name, values, targets in zip(
            _critic_names(len(samples.values)), samples.values, samples.targets, strict=True
        )
    }
    return found | {"kl": monitor.kl, "entropy": monitor.entropy, "passes": monitor.passes} | explained


def _critic_names(count: int) -> list[str]:
    return ["", *(f"cost{name}_" for name in cost_suffixes(count - 1))] if count > 1 else [""] * count
