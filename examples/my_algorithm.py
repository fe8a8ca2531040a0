"""PricedPG, an algorithm of its own in 60 lines: a policy gradient on the reward less a fixed price of cost."""

from typing import Any

import torch
from pydantic import NonNegativeFloat
from torch import Tensor

from thalweg.algos import AlgorithmError, AlgorithmPlugin
from thalweg.algos.constraint.cost_limits import cost_metrics
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.maths.advantages import standardised
from thalweg.algos.onpolicy.agent import Agent
from thalweg.algos.onpolicy.config import FirstOrderConfig
from thalweg.algos.onpolicy.rollout_samples import Signal
from thalweg.core.config import frozen_config


@frozen_config(AlgorithmError)
class PricedPGConfig(FirstOrderConfig):
    """Settings of PricedPG."""

    price: NonNegativeFloat = 2.0
    """Reward that a cost of 1 takes away."""


class PricedPG:
    """One pass of policy-gradient steps for each rollout; `thalweg.algos.interface.Learner` says what a method does."""

    separate_costs = False

    def __init__(self, config: PricedPGConfig, task: Task) -> None:
        self.config, self.agent, self.resets = config, Agent("PricedPG", 1, config, task), config.reset_each_update
        self.policy, self.rollout_steps = self.agent.policy, self.agent.rollout_steps
        self.act, self.warm_up_critics = self.agent.act, self.agent.warm_up_critics
        self.state, self.load_state = self.agent.state, self.agent.load_state

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Take a step for each minibatch, while the critic learns, and return the metrics."""
        config, agent, log = self.config, self.agent, list[Tensor]()
        paid = rollout.rewards - config.price * rollout.costs.sum(-1)
        samples = agent.samples(rollout, [Signal(paid, config.discount, config.trace)])
        rate, data = agent.decay(feedback.progress), (samples.actions, standardised(samples.advantages[0]))
        with agent.critics_learning(samples, config.passes):
            for inputs, (actions, advantages) in samples.minibatches(data, config.minibatch, agent.generator):
                log.append(self._step(inputs, actions, advantages))
        metrics = {"policy_loss": float(torch.stack(log).mean()), "learning_rate": rate}
        return metrics | {"value_loss": float(agent.critic_losses()[0])} | cost_metrics(feedback)

    def _step(self, inputs: Any, actions: Tensor, advantages: Tensor) -> Tensor:
        """Take a step along E[A ∇ log π(a|s)] (Williams 1992), with a bonus for entropy; returns the loss."""
        return self.agent.step(
            inputs, lambda pi: -(pi.log_prob(actions) * advantages).mean() - self.config.entropy * pi.entropy().mean()
        )

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        return {}


PLUGIN = AlgorithmPlugin("PricedPG", PricedPGConfig, PricedPG, "policy gradient at a fixed price of cost", version=1)
