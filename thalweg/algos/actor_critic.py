"""What do algorithms with a policy and critics have in common? Networks, their optimiser and their generator.

How they act, take one step along a gradient, and are put away and brought back stands here once. Losses, updates and
the minibatch loop are absent on purpose: they are the algorithm, and stand in its file.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor, nn

from thalweg.algos.actions import Head, actions_of
from thalweg.algos.interface import Rollout, Task
from thalweg.algos.networks import Critics
from thalweg.algos.onpolicy import Samples, Signal, samples_of, valid_obs
from thalweg.algos.policy import About, Policy
from thalweg.algos.settings import as_data
from thalweg.algos.state import (
    generator_state,
    load_generator,
    load_module,
    load_optimiser,
    module_state,
    optimiser_state,
)


class ActorCriticConfig(Protocol):
    """The settings that such an algorithm has among its own, by the names that it uses for them."""

    @property
    def learning_rate(self) -> float: ...
    @property
    def critic_learning_rate(self) -> float: ...
    @property
    def linear_decay(self) -> bool: ...
    @property
    def max_grad_norm(self) -> float: ...
    @property
    def hidden(self) -> tuple[int, ...]: ...
    @property
    def normalise_observations(self) -> bool: ...
    @property
    def head(self) -> Head: ...
    @property
    def affine(self) -> bool: ...


class ActorCritic:
    """A policy, K critics that share no weights with it, Adam for both, and where all that is random comes from."""

    def __init__(self, algorithm: str, critics: int, config: ActorCriticConfig, task: Task) -> None:
        self.config = config
        self.generator = torch.Generator().manual_seed(task.seed)
        self.policy = Policy(
            task.obs_size,
            actions_of(task.action_space, config.head, config.affine),
            config.hidden,
            normalise=config.normalise_observations,
            generator=self.generator,
            about=About(algorithm, as_data(config), task.context),
        )
        self.critics = Critics(critics, task.obs_size, config.hidden, self.generator)
        self.optimiser = torch.optim.Adam(
            [
                {"params": list(self.policy.actor.parameters()), "lr": config.learning_rate},
                {"params": list(self.critics.parameters()), "lr": config.critic_learning_rate},
            ],
            fused=True,
        )

    def act(self, obs: np.ndarray) -> Tensor:
        """Raw actions [N, A] drawn from the policy, for observations float32 [N, D]."""
        return self.policy.sample(obs, self.generator)

    def samples(self, rollout: Rollout, signals: Sequence[Signal]) -> Samples:
        """The rollout's valid steps with the advantages of each signal, critic k predicting signal k; afterwards the
        rollout counts among the statistics of observations.

        Those statistics change here only, so that the policy that acted is the one learnt from. A fresh policy
        draws alike whatever it sees, so the first rollout's are taken in at once.
        """
        normaliser = self.policy.normaliser
        fresh = normaliser.count == 0
        if fresh:
            normaliser.update(valid_obs(rollout))
        samples = samples_of(rollout, self.critics, normaliser, signals)
        if not fresh:
            normaliser.update(valid_obs(rollout))
        return samples

    def decay(self, progress: float) -> float:
        """Set the policy's learning rate for this share of the run, 0..1, if it is to fall; returns it."""
        rate = self.config.learning_rate * (1.0 - progress if self.config.linear_decay else 1.0)
        self.optimiser.param_groups[0]["lr"] = rate
        return rate

    def step(self, loss: Tensor) -> None:
        """One step of Adam down the gradient of a scalar, the policy's and the critics' shortened each by itself."""
        self.optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.policy.actor.parameters(), self.config.max_grad_norm)
        nn.utils.clip_grad_norm_(self.critics.parameters(), self.config.max_grad_norm)
        self.optimiser.step()

    def state(self) -> dict[str, Any]:
        """Everything, as nested dictionaries of arrays and plain data."""
        return {
            "actor": module_state(self.policy.actor),
            "critics": module_state(self.critics),
            "normaliser": self.policy.normaliser.state(),
            "optimiser": optimiser_state(self.optimiser),
            "generator": generator_state(self.generator),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`; further keys are not looked at."""
        load_module(self.policy.actor, state["actor"])
        load_module(self.critics, state["critics"])
        self.policy.normaliser.load_state(state["normaliser"])
        load_optimiser(self.optimiser, state["optimiser"])
        load_generator(self.generator, state["generator"])
