"""Settings that all off-policy algorithms share."""

from dataclasses import dataclass
from typing import Literal

from thalweg.algos.common.settings import require
from thalweg.algos.constraint.cost_limits import CostConfig
from thalweg.algos.constraint.multiplier import MultiplierConfig
from thalweg.algos.policy.actions import Adapter
from thalweg.algos.policy.mlp import Initial
from thalweg.algos.policy.mlp_autograd import Activation
from thalweg.algos.policy.networks import NetworkShape

Schedule = Literal["report", "gradient_step"]
"""When the multipliers are updated."""


@dataclass(frozen=True)
class OffPolicyConfig(MultiplierConfig, CostConfig):
    """Settings that all off-policy algorithms share; each algorithm has a limit on its costs."""

    steps_per_collection: int = 64
    """Steps between two rounds of learning, all environments together; at least one step of each environment."""
    updates_per_step: float = 0.25
    """Gradient steps per environment step; a fraction that is left after a round is carried over to the next."""
    steps_per_update: int = 2048
    """Steps between two reports, all environments together. At a report the multipliers are updated and metrics are
    logged."""
    multiplier_rate: float = 0.5
    """Step size of the integral part of λ; K_I of a PID multiplier. λ is the reward that one unit of cost is worth."""
    multiplier_gain: float = 1.0
    """K_P: added to λ at once for each unit by which the mean cost exceeds the limit; 0 for none."""
    multiplier_max: float = 50.0
    """Upper bound of λ."""
    multiplier_schedule: Schedule = "report"
    """When the multipliers are updated: at each report, from the episodes finished since the last one ("report"), or at
    each gradient step, as in OmniSafe, which uses the same mean cost many times ("gradient_step")."""
    random_steps: int = 1000
    """Steps with uniformly random actions before the policy acts and learning starts."""
    replay_size: int = 1_000_000
    """Steps that the replay buffer holds."""
    minibatch: int = 256
    """Steps in the batch of one gradient step."""
    discount: float = 0.99
    """γ of the reward."""
    cost_discount: float = 0.99
    """γ of the costs."""
    target_rate: float = 0.01
    """τ: how far the target networks move towards the networks after each update of the policy."""
    policy_delay: int = 1
    """Gradient steps of the critics per gradient step of the policy."""
    learning_rate: float = 1e-3
    """Learning rate of Adam for the policy."""
    critic_learning_rate: float = 1e-3
    """Learning rate of Adam for the critics."""
    linear_decay: bool = True
    """Whether the policy's learning rate falls linearly to 0 over the run, so that the final policy does not depend on
    the point of an oscillation at which training ends."""
    max_grad_norm: float = 40.0
    """Longer gradients are scaled down to this norm, the policy's and that of all critics separately."""
    cost_critics: int = 1
    """Critics of each cost. With two, targets take the larger estimate; of the reward's two, the smaller."""
    cost_floor: bool = True
    """Whether targets clip a cost critic's estimate at 0, as no cost is negative. A policy finds actions whose cost is
    underestimated; without the floor these estimates enter the targets and the error grows without bound."""
    normalise_cost: bool = False
    """Whether critics learn each cost standardised by its running mean and standard deviation and clipped to ±5, as in
    OmniSafe. A step without cost then has a negative cost, and a multiplier weighs another unit. The limit applies to
    raw costs."""
    hidden: tuple[int, ...] = (256, 256)
    """Sizes of the hidden layers, of the policy and of each critic."""
    activation: Activation = "relu"
    """Activation of the hidden layers."""
    initial: Initial = "orthogonal"
    """Initial weights: orthogonal, with a last layer of the policy near zero ("orthogonal"); uniform, as in torch's own
    layers ("kaiming"); or normal, truncated at two standard deviations ("truncated")."""
    normalise_observations: bool = True
    """Whether observations are standardised by running statistics; stored observations by the current ones."""
    adapter: Adapter = "native"
    """Discrete actions as choices ("native"), or as numbers that are rounded ("box_literal", "box_scaled")."""
    frame_stack: int = 1
    """Number of the last observations that are stacked."""

    def __post_init__(self) -> None:
        require(self, self.conditions())

    def conditions(self) -> dict[str, tuple[bool, str]]:
        """Condition and message for each field."""
        return (
            self.multiplier_conditions()
            | self.cost_conditions()
            | {
                "steps_per_collection": (self.steps_per_collection > 0, "must be positive"),
                "updates_per_step": (self.updates_per_step > 0, "must be positive"),
                "steps_per_update": (self.steps_per_update > 0, "must be positive"),
                "random_steps": (self.random_steps >= 0, "must not be negative"),
                "replay_size": (self.replay_size > 0, "must be positive"),
                "minibatch": (self.minibatch > 0, "must be positive"),
                "discount": (0 <= self.discount <= 1, "must be in 0..1"),
                "cost_discount": (0 <= self.cost_discount <= 1, "must be in 0..1"),
                "target_rate": (0 < self.target_rate <= 1, "must be in 0..1, and more than 0"),
                "policy_delay": (self.policy_delay > 0, "must be positive"),
                "learning_rate": (self.learning_rate >= 0, "must not be negative"),
                "critic_learning_rate": (self.critic_learning_rate >= 0, "must not be negative"),
                "max_grad_norm": (self.max_grad_norm > 0, "must be positive"),
                "hidden": (all(size > 0 for size in self.hidden), "must be positive"),
                "cost_floor": (not (self.cost_floor and self.normalise_cost), "must be off with normalise_cost"),
                "cost_critics": (self.cost_critics in (1, 2), "must be 1 or 2"),
                "frame_stack": (self.frame_stack > 0, "must be positive"),
            }
        )

    @property
    def shape(self) -> NetworkShape:
        """NetworkShape of the networks."""
        return NetworkShape(self.hidden, self.activation, self.initial)
