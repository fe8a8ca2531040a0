"""First-order constrained optimisation in policy space (Zhang, Vuong, Ross 2020): the best policy within a trust
region and a cost limit, in closed form, then projected back onto what the network can express, state by state."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.actions import Head
from thalweg.algos.actor_critic import ActorCritic
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.maths import losses
from thalweg.algos.maths.advantages import centred, standardised
from thalweg.algos.multiplier import Multiplier, Rule
from thalweg.algos.onpolicy import Signal, minibatches, require_finite
from thalweg.algos.settings import require


@dataclass(frozen=True)
class FOCOPSConfig:
    """Settings of FOCOPS."""

    cost_limit: float = 0.1
    """d: the mean cost that an episode may have."""
    temperature: float = 0.5
    """λ: how little the policy follows the advantages for each nat that it moves."""
    trust_radius: float = 0.02
    """η: a state whose policy has moved further than this is drawn by neither advantages nor KL, only by the entropy:
    KL of all branches together, in nats."""
    target_kl: float = 0.02
    """No further pass once the mean KL over all states exceeds this."""
    mask: Literal["state", "batch"] = "state"
    """"state": the trust region of the paper. "batch": the weaker one that OmniSafe 0.5 computes by a broadcast."""
    multiplier_rule: Rule = "gradient"
    """How the multiplier ν moves: projected gradient, as in the paper, or Adam."""
    multiplier_rate: float = 1.0
    """Step size of the part of ν that moves."""
    multiplier_gain: float = 10.0
    """K_P: what is added to ν for each unit by which the mean cost exceeds the limit, at once; the paper has none."""
    multiplier_initial: float = 0.0
    """ν before the first update."""
    multiplier_max: float = 2.0
    """Upper bound of ν."""
    standardise_cost: bool = True
    """Whether the cost advantage is divided by its own deviation, so that ν compares like with like; else only
    centred."""
    steps_per_update: int = 2048
    """Steps between updates, all environments together."""
    passes: int = 10
    """How often an update goes through its steps, at most."""
    minibatch: int = 256
    """Steps of one gradient step, about."""
    learning_rate: float = 1e-3
    """Adam's, for the policy."""
    critic_learning_rate: float = 1e-3
    """Adam's, for the critics."""
    linear_decay: bool = True
    """Whether the policy's learning rate falls linearly to 0 over the run."""
    discount: float = 0.99
    """γ of the reward."""
    trace: float = 0.95
    """λ of generalised advantage estimation, of the reward."""
    cost_discount: float = 0.99
    """γ of the cost."""
    cost_trace: float = 0.95
    """λ of generalised advantage estimation, of the cost."""
    entropy: float = 0.005
    """Weight of the policy's entropy (nats, summed over branches) in the loss; the paper has none."""
    max_grad_norm: float = 1.0
    """Longer gradients are shortened to this, the policy's and the critics' each by itself."""
    hidden: tuple[int, ...] = (64, 64)
    """Sizes of the hidden layers, of the policy and of each critic."""
    normalise_observations: bool = True
    """Whether observations are standardised by running statistics."""
    head: Head = "native"
    """"native": categorical for discrete actions, Gaussian for a Box. "gaussian_discretised": a Gaussian, rounded."""
    affine: bool = False
    """For the discretised Gaussian: whether a sample of 0 is the middle option (the paper does not say; its code:
    no)."""

    def __post_init__(self) -> None:
        require(
            cost_limit=(self.cost_limit >= 0, "must not be negative"),
            temperature=(self.temperature > 0, "must be positive"),
            trust_radius=(self.trust_radius > 0, "must be positive"),
            target_kl=(self.target_kl > 0, "must be positive (inf: never stop early)"),
            multiplier_rate=(self.multiplier_rate >= 0, "must not be negative"),
            multiplier_gain=(self.multiplier_gain >= 0, "must not be negative"),
            multiplier_max=(self.multiplier_max >= 0, "must not be negative"),
            multiplier_initial=(0 <= self.multiplier_initial <= self.multiplier_max, "must be in 0..multiplier_max"),
            steps_per_update=(self.steps_per_update > 0, "must be positive"),
            passes=(self.passes > 0, "must be positive"),
            minibatch=(self.minibatch > 0, "must be positive"),
            learning_rate=(self.learning_rate >= 0, "must not be negative"),
            critic_learning_rate=(self.critic_learning_rate >= 0, "must not be negative"),
            discount=(0 <= self.discount <= 1, "must be in 0..1"),
            trace=(0 <= self.trace <= 1, "must be in 0..1"),
            cost_discount=(0 <= self.cost_discount <= 1, "must be in 0..1"),
            cost_trace=(0 <= self.cost_trace <= 1, "must be in 0..1"),
            max_grad_norm=(self.max_grad_norm > 0, "must be positive"),
        )


def policy_loss(
    config: FOCOPSConfig, log_prob: Tensor, old_log_prob: Tensor, kl: Tensor, advantages: Tensor, entropy: Tensor
) -> Tensor:
    """L = E_s[1{KL_s ≤ η} (KL_s - ρ (A_r - ν A_c) / λ)] - c E_s[H_s]: what the policy minimises, from one number per
    state [B] each. The entropy counts in every state, outside η too."""
    projection = losses.focops(
        log_prob,
        old_log_prob,
        kl,
        advantages,
        temperature=config.temperature,
        radius=config.trust_radius,
        mask=config.mask,
    )
    return projection - config.entropy * entropy.mean()


class FOCOPS:
    """FOCOPS at work."""

    def __init__(self, config: FOCOPSConfig, task: Task) -> None:
        self.config = config
        self.rollout_steps = max(2, config.steps_per_update // task.num_envs)
        self.agent = ActorCritic("FOCOPS", 2, config, task)
        self.policy = self.agent.policy
        self.multiplier = Multiplier(config)

    def act(self, obs: np.ndarray) -> Tensor:
        """Raw actions [N, A] drawn from the policy, for observations float32 [N, D]."""
        return self.agent.act(obs)

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """The multiplier first, then passes until the policy has moved by `target_kl`; returns the metrics."""
        config, policy = self.config, self.policy
        self.multiplier.update(feedback.cost_mean)
        signals = [
            Signal(rollout.rewards, config.discount, config.trace),
            Signal(rollout.costs, config.cost_discount, config.cost_trace),
        ]
        samples = self.agent.samples(rollout, signals)
        with torch.no_grad():
            old_parameters = policy.actor(samples.obs)
            old = policy.actions.distribution(old_parameters)
            old_log_prob = old.log_prob(samples.actions)
        rate = self.agent.decay(feedback.progress)

        scaled = standardised if config.standardise_cost else centred
        advantages = standardised(samples.advantages[0]) - self.multiplier.value * scaled(samples.advantages[1])
        data = (samples.obs, samples.actions, old_parameters, old_log_prob, advantages, samples.targets.T)
        log: list[Tensor] = []
        passes, kl, entropy, inside = 0, 0.0, 0.0, 1.0
        while passes < config.passes and kl <= config.target_kl:
            for batch in minibatches(data, config.minibatch, self.agent.generator):
                log.append(self._step(*batch))
            passes += 1
            with torch.no_grad():
                new = policy.actions.distribution(policy.actor(samples.obs))
                per_state = new.kl(old)
                kl, entropy = float(per_state.mean()), float(new.entropy().mean())
                inside = float((per_state <= config.trust_radius).float().mean())
            require_finite(kl=kl, entropy=entropy)
        policy_part, value_part, cost_part = torch.stack(log).mean(0).tolist()
        require_finite(policy_loss=policy_part, value_loss=value_part, cost_value_loss=cost_part)
        return {
            "policy_loss": policy_part,
            "value_loss": value_part,
            "cost_value_loss": cost_part,
            "kl": kl,
            "entropy": entropy,
            "inside_fraction": inside,
            "explained_variance": losses.explained_variance(samples.values[0], samples.targets[0]),
            "cost_explained_variance": losses.explained_variance(samples.values[1], samples.targets[1]),
            "passes": passes,
            "learning_rate": rate,
            "multiplier": self.multiplier.value,
            "multiplier_reach": self.multiplier.reach(feedback.updates_left - 1, feedback.largest_cost),
            "limit_can_bind": float(feedback.largest_cost > config.cost_limit),
            "cost_mean": feedback.cost_mean,
            "cost_episodes": feedback.cost_episodes,
        }

    def _step(
        self,
        obs: Tensor,
        actions: Tensor,
        old_parameters: Tensor,
        old_log_prob: Tensor,
        advantages: Tensor,
        targets: Tensor,
    ) -> Tensor:
        """One gradient step of policy and critics, which share no weights; returns the three losses [3]."""
        distribution = self.policy.actions.distribution(self.policy.actor(obs))
        projection = policy_loss(
            self.config,
            distribution.log_prob(actions),
            old_log_prob,
            distribution.kl(self.policy.actions.distribution(old_parameters)),
            advantages,
            distribution.entropy(),
        )
        errors = losses.squared_error(self.agent.critics(obs), targets.T)
        self.agent.step(projection + errors.sum())
        return torch.cat([projection.detach().unsqueeze(0), errors.detach()])

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """What keeps the cost limit or its multiplier from doing its work."""
        return self.multiplier.warnings(feedback.updates_left, feedback.episodes, feedback.largest_cost)

    def state(self) -> dict[str, Any]:
        return self.agent.state() | {"multiplier": self.multiplier.state()}

    def load_state(self, state: dict[str, Any]) -> None:
        self.agent.load_state(state)
        self.multiplier.load_state(state["multiplier"])
