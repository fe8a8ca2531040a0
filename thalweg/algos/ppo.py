"""Proximal policy optimisation (Schulman et al. 2017) for the reward alone: the baseline that knows no cost."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.actions import Head
from thalweg.algos.actor_critic import ActorCritic
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.maths import losses
from thalweg.algos.maths.advantages import standardised
from thalweg.algos.onpolicy import Signal, minibatches, require_finite
from thalweg.algos.settings import require


@dataclass(frozen=True)
class PPOConfig:
    """Settings of PPO."""

    steps_per_update: int = 2048
    """Steps between updates, all environments together."""
    passes: int = 10
    """How often an update goes through its steps, at most."""
    minibatch: int = 256
    """Steps of one gradient step, about."""
    learning_rate: float = 1e-3
    """Adam's, for the policy."""
    critic_learning_rate: float = 1e-3
    """Adam's, for the critic."""
    linear_decay: bool = True
    """Whether the policy's learning rate falls linearly to 0 over the run."""
    discount: float = 0.99
    """γ of the reward."""
    trace: float = 0.95
    """λ of generalised advantage estimation."""
    clip: float = 0.2
    """ε: how far the probability ratio counts, to either side of 1."""
    target_kl: float = 0.02
    """No further pass once the policy is this far from the one that acted: mean KL of all branches together, in
    nats."""
    entropy: float = 0.01
    """Weight of the policy's entropy (nats, summed over branches) in the loss."""
    max_grad_norm: float = 1.0
    """Longer gradients are shortened to this, the policy's and the critic's each by itself."""
    hidden: tuple[int, ...] = (64, 64)
    """Sizes of the hidden layers, of the policy and of the critic."""
    normalise_observations: bool = True
    """Whether observations are standardised by running statistics."""
    head: Head = "native"
    """"native": categorical for discrete actions, Gaussian for a Box. "gaussian_discretised": a Gaussian, rounded."""
    affine: bool = False
    """For the discretised Gaussian: whether a sample of 0 is the middle option (the paper does not say; its code:
    no)."""

    def __post_init__(self) -> None:
        require(
            steps_per_update=(self.steps_per_update > 0, "must be positive"),
            passes=(self.passes > 0, "must be positive"),
            minibatch=(self.minibatch > 0, "must be positive"),
            learning_rate=(self.learning_rate >= 0, "must not be negative"),
            critic_learning_rate=(self.critic_learning_rate >= 0, "must not be negative"),
            discount=(0 <= self.discount <= 1, "must be in 0..1"),
            trace=(0 <= self.trace <= 1, "must be in 0..1"),
            clip=(self.clip > 0, "must be positive"),
            target_kl=(self.target_kl > 0, "must be positive (inf: never stop early)"),
            max_grad_norm=(self.max_grad_norm > 0, "must be positive"),
        )


def policy_loss(
    config: PPOConfig, log_prob: Tensor, old_log_prob: Tensor, advantages: Tensor, entropy: Tensor
) -> Tensor:
    """L = L_clip - c H: what the policy minimises, from one number per state [B] each."""
    return losses.ppo_clip(log_prob, old_log_prob, advantages, config.clip) - config.entropy * entropy.mean()


class PPO:
    """PPO at work."""

    def __init__(self, config: PPOConfig, task: Task) -> None:
        self.config = config
        self.rollout_steps = max(2, config.steps_per_update // task.num_envs)
        self.agent = ActorCritic("PPO", 1, config, task)
        self.policy = self.agent.policy

    def act(self, obs: np.ndarray) -> Tensor:
        """Raw actions [N, A] drawn from the policy, for observations float32 [N, D]."""
        return self.agent.act(obs)

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Passes over the rollout's steps until the policy has moved by `target_kl`; returns the metrics."""
        config, policy = self.config, self.policy
        signals = [Signal(rollout.rewards, config.discount, config.trace)]
        samples = self.agent.samples(rollout, signals)
        with torch.no_grad():
            old = policy.actions.distribution(policy.actor(samples.obs))
            old_log_prob = old.log_prob(samples.actions)
        rate = self.agent.decay(feedback.progress)

        advantages = standardised(samples.advantages[0])
        data = (samples.obs, samples.actions, old_log_prob, advantages, samples.targets[0])
        log: list[Tensor] = []
        passes, kl, entropy = 0, 0.0, 0.0
        while passes < config.passes and kl <= config.target_kl:
            for batch in minibatches(data, config.minibatch, self.agent.generator):
                log.append(self._step(*batch))
            passes += 1
            with torch.no_grad():
                new = policy.actions.distribution(policy.actor(samples.obs))
                kl, entropy = float(old.kl(new).mean()), float(new.entropy().mean())
                moved = (new.log_prob(samples.actions) - old_log_prob).exp() - 1.0
            require_finite(kl=kl, entropy=entropy)
        policy_part, value_part = torch.stack(log).mean(0).tolist()
        require_finite(policy_loss=policy_part, value_loss=value_part)
        return {
            "policy_loss": policy_part,
            "value_loss": value_part,
            "kl": kl,
            "entropy": entropy,
            "clip_fraction": float((moved.abs() > config.clip).float().mean()),
            "explained_variance": losses.explained_variance(samples.values[0], samples.targets[0]),
            "passes": passes,
            "learning_rate": rate,
            "cost_mean": feedback.cost_mean,
            "cost_episodes": feedback.cost_episodes,
        }

    def _step(self, obs: Tensor, actions: Tensor, old_log_prob: Tensor, advantages: Tensor, targets: Tensor) -> Tensor:
        """One gradient step of policy and critic, which share no weights; returns both losses [2]."""
        distribution = self.policy.actions.distribution(self.policy.actor(obs))
        surrogate = policy_loss(
            self.config, distribution.log_prob(actions), old_log_prob, advantages, distribution.entropy()
        )
        error = losses.squared_error(self.agent.critics(obs), targets.unsqueeze(0)).sum()
        self.agent.step(surrogate + error)
        return torch.stack([surrogate.detach(), error.detach()])

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """Nothing: PPO has no limit that could fail to bind."""
        return {}

    def state(self) -> dict[str, Any]:
        return self.agent.state()

    def load_state(self, state: dict[str, Any]) -> None:
        self.agent.load_state(state)
