"""Proximal policy optimisation (Schulman et al. 2017) for the reward alone: the baseline, which ignores costs."""

from typing import Any

from pydantic import PositiveFloat
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.constraint.cost_limits import cost_metrics
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.maths import losses
from thalweg.algos.maths.advantages import standardised
from thalweg.algos.onpolicy.agent import Agent, metrics_of, reward_signal
from thalweg.algos.onpolicy.config import FirstOrderConfig
from thalweg.algos.onpolicy.kl_monitor import KLMonitor
from thalweg.algos.policy.memory import Sequences
from thalweg.core.config import Fraction, frozen_config


@frozen_config(AlgorithmError)
class PPOConfig(FirstOrderConfig):
    """Settings of PPO."""

    asymmetric_critics: bool = True
    """Whether critics also see what the environment tells them beyond the observation (`info["critic_obs"]`), such as
    the privileged state and progress; the policy does not (Pinto et al. 2018)."""
    discount: Fraction = 0.995
    """Discount factor γ of the reward."""
    clip: PositiveFloat = 0.2
    """Clip range ε: the probability ratio is clipped to 1 ± ε."""


def policy_loss(
    config: PPOConfig, log_prob: Tensor, old_log_prob: Tensor, advantages: Tensor, entropy: Tensor
) -> Tensor:
    """Return L = L_clip - c H, the loss of the policy, from arguments of shape [B]."""
    return losses.ppo_clip(log_prob, old_log_prob, advantages, config.clip) - config.entropy * entropy.mean()


class PPO:
    """The PPO algorithm; see `Learner` for its methods."""

    separate_costs = False

    def __init__(self, config: PPOConfig, task: Task) -> None:
        self.config = config
        self.agent = Agent("PPO", 1, config, task)
        self.policy, self.rollout_steps, self.resets = (
            self.agent.policy,
            self.agent.rollout_steps,
            config.reset_each_update,
        )

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Return raw actions [N, A] sampled from the policy."""
        return self.agent.act(obs, fresh)

    def warm_up_critics(self) -> None:
        """Let only the critics learn during the next `critic_warmup_steps`."""
        self.agent.warm_up_critics()

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Train until the KL exceeds `target_kl` or all passes are done, and return the metrics."""
        config, agent = self.config, self.agent
        samples = agent.samples(rollout, [reward_signal(config, rollout)])
        rate, monitor = agent.decay(feedback.progress), KLMonitor(agent, samples)
        data = (samples.actions, monitor.old_log_prob, standardised(samples.advantages[0]), samples.imitated)
        log: list[Tensor] = []
        while monitor.may_continue:
            with agent.critics_learning(samples):
                for inputs, rows in samples.minibatches(data, config.minibatch, agent.generator):
                    log.append(self._step(inputs, *rows))
            monitor.measure()
        return (
            metrics_of(agent, samples, log, monitor)
            | {"learning_rate": rate, "clip_fraction": monitor.clip_fraction(config.clip)}
            | cost_metrics(feedback)
        )

    def _step(
        self,
        inputs: Tensor | Sequences,
        actions: Tensor,
        old_log_prob: Tensor,
        advantages: Tensor,
        imitated: Tensor,
    ) -> Tensor:
        """Take one gradient step of the policy, and return its loss."""
        return self.agent.step(
            inputs,
            lambda new: policy_loss(self.config, new.log_prob(actions), old_log_prob, advantages, new.entropy()),
            imitated,
        )

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """Return a warning about a policy that never learns; PPO has no cost limit."""
        return self.agent.warnings(feedback)

    def state(self) -> dict[str, Any]:
        return self.agent.state()

    def load_state(self, state: dict[str, Any]) -> None:
        self.agent.load_state(state)
