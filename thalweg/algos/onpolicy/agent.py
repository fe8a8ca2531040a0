"""Shared components of on-policy algorithms: agent, optimisers, signals of critics and metrics.

Losses, updates and the minibatch loop are not here on purpose: they are in the file of each algorithm. Letters:
B valid steps, N environments, K frames, D numbers of an observation, C numbers that only critics see, M costs.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Protocol, cast

import gymnasium as gym
import torch
from torch import Tensor

from thalweg.algos.common.adam import Adam
from thalweg.algos.common.errors import AlgorithmError, require_finite
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
from thalweg.algos.onpolicy.imitated import Imitated
from thalweg.algos.onpolicy.kl_monitor import KLMonitor
from thalweg.algos.onpolicy.rollout_samples import RolloutMemory, Samples, Signal, of_valid_steps, samples_of
from thalweg.algos.policy import fast_path
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.distributions import AnalyticDistribution, Distribution, TapedDistribution
from thalweg.algos.policy.memory import Sequences
from thalweg.algos.policy.networks import Critics
from thalweg.algos.policy.normaliser import Normaliser
from thalweg.algos.policy.player import NetworkPlayer
from thalweg.algos.policy.policy import Policy
from thalweg.algos.policy.policy_file import About
from thalweg.algos.policy.vision import FIRST_STRIDE, MOST_OPTIONS
from thalweg.core.config import to_plain


class Agent:
    """A policy, critics that share no weights with it, their optimisers and their random generators."""

    def __init__(self, algorithm: str, critics: int, config: OnPolicyConfig, task: Task) -> None:
        """Raises `AlgorithmError` if the config's policy does not see what the task shows."""
        check_sight(config, task)
        self.config = config
        self.generator = new_generator(task.device, task.seed)
        self.policy = Policy(
            task.obs_size,
            actions_of(task.action_space, config.adapter),
            config.shape(task.image),
            frames=config.frame_stack,
            normalise=config.normalise_observations,
            generator=self.generator,
            about=About(algorithm, to_plain(config), task.context),
        )
        told = task.critic_size if config.told_critics else 0
        own = 0 if config.sees_images else config.frame_stack * task.obs_size
        self.critics = Critics(critics, own + told, config.critic_shape, self.generator)
        self.critic_normaliser = Normaliser(told, config.normalise_observations, task.device) if told else None
        """Of the C numbers that only critics see; None if they see the observation alone."""
        self.imitation_weight = 0.0
        """Weight, in this update, of the KL from the policy that the run begins with; `decay` and `NaturalStep` set
        it."""
        self.critics_warm_up = False
        """Whether only the critics learn in this update; known after `samples`."""
        self._warmup_left = 0
        rate = config.learning_rate if isinstance(config, FirstOrderConfig) else 0.0
        self.policy_optimiser = Adam(self.policy.actor.parameters(), rate)
        self.critic_optimiser = Adam(self.critics.parameters(), config.critic_learning_rate)
        critic_seed = torch.randint(2**62, (), generator=self.generator, device=task.device)
        self._critic_generator = new_generator(task.device, int(critic_seed))
        self._critic_log: list[Tensor] = []
        self._critic_thread = ThreadPoolExecutor(1, "critics")
        self._player = NetworkPlayer(self.policy, task.num_envs, False, self.generator, stacked=True)
        self._memory: RolloutMemory | None = None
        if (gru := self.policy.actor.gru) is not None:
            eyes = self.policy.actor.eyes
            self._memory = RolloutMemory(gru, self.critics.gru, task.num_envs, config.sequence, eyes)
        self._imitated: Imitated | None = None

    @property
    def rollout_steps(self) -> int:
        """T: steps of each environment between updates."""
        return self.config.rollout_steps(self._player.num_envs)

    def warm_up_critics(self) -> None:
        """Let only the critics learn in the rollouts that begin within the next `critic_warmup_steps`.

        Policy, statistics of observations, optimiser and multipliers stay as they are. The critics' weights of numbers
        that the policy's statistics never saw vary are set to 0, as are the policy's (`Policy.initialise_from`). To be
        called before the first step; a restored state has its own count.
        """
        self._warmup_left = self.config.critic_warmup_steps
        if not self.config.sees_images:
            self.critics.clear_inputs(self.policy.normaliser.ignored)

    @contextmanager
    def critics_learning(self, samples: Samples, passes: int = 1) -> Iterator[None]:
        """Train the critics by `passes` over the samples while the body of the `with` block runs.

        Critics and policy share no weights and the advantages are known already, so a thread trains the critics by
        compiled loops, which release the interpreter lock. Otherwise they are trained after the body. The numbers are
        the same either way.
        """
        if self.critics.compiled:
            learning = self._critic_thread.submit(self._learn_critics, samples, passes)
            try:
                yield
            finally:
                self._critic_log += learning.result()
        else:
            yield
            self._critic_log += self._learn_critics(samples, passes)

    def critic_losses(self) -> Tensor:
        """Return ½ E[(V - target)²] of each critic, the mean over gradient steps since the last call."""
        means = torch.stack(self._critic_log).mean(0)
        self._critic_log = []
        return means

    def _learn_critics(self, samples: Samples, passes: int) -> list[Tensor]:
        """Train the critics and return their losses for each gradient step."""
        config, generator, targets = self.config, self._critic_generator, samples.targets.T
        samples = samples.of_critics
        if isinstance(samples.inputs, Tensor) and self.critics.compiled:
            return [
                error
                for _ in range(passes)
                for error in self.critics.fit_epoch(
                    *samples.shuffled((targets,), generator),
                    minibatch=config.minibatch,
                    optimiser=self.critic_optimiser,
                    l2=config.critic_decay,
                    max_norm=config.max_grad_norm,
                )
            ]
        found = []
        for _ in range(passes):
            for inputs, (minibatch_targets,) in samples.minibatches((targets,), config.minibatch, generator):
                found.append(self.critics.regress(inputs, minibatch_targets.T, config.critic_decay))
                self.critic_optimiser.step(config.max_grad_norm)
        return found

    def updates_left(self, feedback: Feedback) -> int:
        """Return the number of updates that remain after this one and after the critics' warm-up."""
        return math.ceil(max(feedback.steps_left - self._warmup_left, 0) / (self.rollout_steps * self._player.num_envs))

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """Return a warning, by a short code, if the run ends before the policy that it began with begins to learn."""
        if not self.critics_warm_up or self._warmup_left < feedback.steps_left:
            return {}
        sentence = (
            f"the critics warm up for the first {self.config.critic_warmup_steps:,} steps (critic_warmup_steps), and no"
            " rollout begins after them, since steps that only reset an environment do not count: the policy stays what"
            " it began with; take more steps, or lower critic_warmup_steps"
        )
        return {"policy_never_learns": sentence}

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Return raw actions [N, A] sampled from the policy, for observations float32 [N, K * D]."""
        return self._player.raw(obs, fresh)

    def samples(self, rollout: Rollout, signals: Sequence[Signal]) -> Samples:
        """Return the rollout's valid steps with the advantages of each signal; critic k predicts signal k.

        Afterwards the statistics of observations include the rollout. They change only here, so that the samples are
        evaluated by the policy that collected them. An untrained policy with orthogonal weights and bounded activations
        is nearly uniform in every state, so the statistics of the first rollout are included at once. Those of what
        only critics see, by which nobody acts, always include the first rollout at once.
        """
        normaliser, told, config = self.policy.normaliser, self.critic_normaliser, self.config
        self._count_warmup(rollout)
        untrained = normaliser.count == 0 and config.initial == "orthogonal" and config.activation == "tanh"
        first = told is not None and told.count == 0
        self._update_statistics(rollout, untrained, first)
        samples = samples_of(
            rollout, self.critics, normaliser, signals, self._memory, told, not config.sees_images
        )  # fmt: skip
        if (imitated := self.imitated) is not None:
            samples = replace(samples, imitated=imitated.parameters(rollout)[samples.index])
        self._update_statistics(rollout, not untrained and not self.critics_warm_up, not first)
        if self._memory is not None:
            self._memory.advance()
            # The states differ after the first rollout, which was collected without statistics.
            self._player.hidden = self._memory.starts["actor"]
        return samples

    @property
    def imitated(self) -> Imitated | None:
        """The policy that the run begins with, if a KL to it is in the loss."""
        if self._imitated is None and self.config.imitation_kl and self.policy.origin is not None:
            self._imitated = Imitated(self.policy.origin, self._player.num_envs)
        return self._imitated

    def imitation(self, new: Distribution | TapedDistribution, imitated: Tensor) -> Tensor | float:
        """Return w E[KL(π ‖ π_0)] of the policy's distribution at B states, for parameters [B, P] of π_0; 0 for P = 0.

        (Schmitt et al. 2018, with the divergence in the other direction: moves that the imitated policy avoids cost
        most.)
        """
        if not self.imitation_weight or not imitated.shape[1]:
            return 0.0
        return self.imitation_weight * new.kl(self.policy.actions.distribution(imitated)).mean()

    def _count_warmup(self, rollout: Rollout) -> None:
        """Find out whether only the critics learn from this rollout."""
        self.critics_warm_up = self._warmup_left > 0
        if self.critics_warm_up:
            self._warmup_left = max(self._warmup_left - int(rollout.valid.sum()), 0)

    def _update_statistics(self, rollout: Rollout, obs: bool, critic_obs: bool) -> None:
        """Include the rollout in the statistics of observations, and of what only critics see."""
        if obs:
            self.policy.normaliser.update(of_valid_steps(rollout, rollout.obs))
        if critic_obs and self.critic_normaliser is not None and rollout.critic_obs is not None:
            self.critic_normaliser.update(of_valid_steps(rollout, rollout.critic_obs))

    def decay(self, progress: float) -> float:
        """Set the policy's learning rate, and the weight of the KL from the policy that the run begins with, for this
        share of the run, 0..1; returns the rate; 0 while critics warm up."""
        assert isinstance(self.config, FirstOrderConfig)
        self.imitation_weight = self.config.imitation_weight(progress)
        rate = self.config.learning_rate * (1.0 - progress if self.config.linear_decay else 1.0)
        rate = 0.0 if self.critics_warm_up else rate
        self.policy_optimiser.rate = rate
        return rate

    def step(
        self,
        inputs: Tensor | Sequences,
        loss_of: Callable[[Distribution | TapedDistribution], Tensor],
        imitated: Tensor | None = None,
    ) -> Tensor:
        """Take one step of Adam of the policy, and return the loss, detached; no step while critics warm up.

        `loss_of` takes the policy's action distribution at the B states of `inputs` and returns a scalar. With
        `imitated`, parameters [B, P] of the policy that the run begins with, the KL from that one is added to it, see
        `imitation`.
        """

        def whole_loss(new: Distribution | TapedDistribution) -> Tensor:
            return loss_of(new) if imitated is None else loss_of(new) + self.imitation(new, imitated)

        if self.critics_warm_up:
            with torch.no_grad():
                return whole_loss(self.policy.distribution_of(inputs))
        if not fast_path.enabled():  # autograd, which defines the result
            self.policy_optimiser.zero_grad()
            loss = whole_loss(self.policy.distribution_of(inputs))
            loss.backward()
            self.policy_optimiser.step(self.config.max_grad_norm)
            return loss.detach()
        parameters, backward = self.policy.actor.forward_and_backward(inputs)
        new = TapedDistribution(cast(AnalyticDistribution, self.policy.actions.distribution(parameters)))
        loss = whole_loss(new)
        loss.backward()
        backward(new.parameter_grad())
        self.policy_optimiser.step(self.config.max_grad_norm)
        return loss.detach()

    def state(self) -> dict[str, Any]:
        """Return everything that learning needs to resume, as nested dictionaries of arrays and plain data."""
        state = {
            "actor": module_state(self.policy.actor),
            "critics": module_state(self.critics),
            "normaliser": self.policy.normaliser.state(),
            "policy_optimiser": self.policy_optimiser.state(),
            "critic_optimiser": self.critic_optimiser.state(),
            "generator": generator_state(self.generator),
            "critic_generator": generator_state(self._critic_generator),
            "player": self._player.state(),
            "warmup_left": self._warmup_left,
        }
        if self.critic_normaliser is not None:
            state["critic_normaliser"] = self.critic_normaliser.state()
        if self.imitated is not None:
            state["imitated"] = self.imitated.state()
        return state if self._memory is None else state | {"memory": self._memory.state()}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned; further keys are ignored."""
        load_module(self.policy.actor, state["actor"])
        load_module(self.critics, state["critics"])
        self.policy.normaliser.load_state(state["normaliser"])
        self.policy_optimiser.load_state(state["policy_optimiser"])
        self.critic_optimiser.load_state(state["critic_optimiser"])
        load_generator(self.generator, state["generator"])
        load_generator(self._critic_generator, state["critic_generator"])
        self._player.load_state(state["player"])
        self._warmup_left = int(state.get("warmup_left", 0))
        if self.critic_normaliser is not None:
            self.critic_normaliser.load_state(state["critic_normaliser"])
        if self.imitated is not None:
            self.imitated.load_state(state["imitated"])
        if self._memory is not None:
            self._memory.load_state(state["memory"])


def check_sight(config: OnPolicyConfig, task: Task) -> None:
    """Raise `AlgorithmError` unless a config's policy sees what a task shows, and its critics see anything."""
    if not config.sees_images:
        if task.image is not None:
            raise AlgorithmError("the observations are images, which only a policy with policy=cnn sees")
        return
    if task.image is None:
        raise AlgorithmError(
            f"policy=cnn sees images, but the observations are {task.obs_size} numbers: use policy=mlp"
        )
    if min(task.image) < 1 or min(task.image[:2]) < FIRST_STRIDE:
        raise AlgorithmError(
            f"policy=cnn sees images of at least {FIRST_STRIDE}x{FIRST_STRIDE} pixels, not {task.image}"
        )
    if not isinstance(task.action_space, gym.spaces.Discrete | gym.spaces.MultiDiscrete):
        raise AlgorithmError(f"policy=cnn remembers the options that it took: it has none in {task.action_space}")
    space = task.action_space
    options = int(space.n) if isinstance(space, gym.spaces.Discrete) else int(space.nvec.max())
    if options > MOST_OPTIONS:
        raise AlgorithmError(f"policy=cnn remembers options of at most {MOST_OPTIONS} a branch, not {options}")
    if not task.critic_size:
        raise AlgorithmError(
            "with policy=cnn critics see what the environment tells them alone, and this one tells nothing: it needs"
            " single_critic_space and info['critic_obs']"
        )


def reward_signal(config: OnPolicyConfig, rollout: Rollout) -> Signal:
    """Return the reward as the signal that the first critic predicts."""
    return Signal(rollout.rewards, config.discount, config.trace)


class CostSignalSettings(Protocol):
    """Settings that the signals of costs depend on."""

    @property
    def cost_discount(self) -> float: ...

    @property
    def cost_trace(self) -> float: ...

    @property
    def told_critics(self) -> bool: ...


def cost_signals(config: CostSignalSettings, rollout: Rollout) -> list[Signal]:
    """Return each cost as a signal that one of the other critics predicts.

    Critics that are told the share of steps know when the step limit comes, at which the cost of the episode is
    complete; if their targets went on beyond it, its last cost would be charged again and again at a share of 1.
    """
    told = config.told_critics and rollout.critic_obs is not None
    return [Signal(cost, config.cost_discount, config.cost_trace, told) for cost in rollout.costs.unbind(-1)]


def cost_advantages(config: ConstrainedConfig, samples: Samples) -> Tensor:
    """Return A_c [M, B], centred, and divided by their standard deviations if the config says so."""
    scaled = standardised if config.standardise_cost else centred
    return torch.stack([scaled(advantages) for advantages in samples.advantages[1:]])


def metrics_of(agent: Agent, samples: Samples, log: Sequence[Tensor], monitor: KLMonitor) -> dict[str, float]:
    """Return the metrics of every update: mean losses, explained variances, KL, entropy and passes.

    `log` holds the policy's loss of each gradient step. Raises `NotFiniteError` if a loss is NaN.
    """
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
    imitation = {"imitation_kl": monitor.imitation_kl} if samples.imitated.shape[1] else {}
    found |= {"kl": monitor.kl, "entropy": monitor.entropy, "passes": monitor.passes}
    return found | imitation | explained


def _critic_names(count: int) -> list[str]:
    return ["", *(f"cost{name}_" for name in cost_suffixes(count - 1))] if count > 1 else [""] * count
