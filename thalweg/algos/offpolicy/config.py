"""Which settings do all off-policy algorithms have?"""

from dataclasses import dataclass
from typing import Literal

from thalweg.algos.common.settings import require
from thalweg.algos.constraint.cost_limits import CostConfig
from thalweg.algos.constraint.multiplier import MultiplierConfig
from thalweg.algos.policy.actions import Adapter
from thalweg.algos.policy.mlp_autograd import Activation
from thalweg.algos.policy.networks import Initial, Shape

Schedule = Literal["report", "gradient_step"]
"""When the multipliers move."""


@dataclass(frozen=True)
class OffPolicyConfig(MultiplierConfig, CostConfig):
    """Settings of every off-policy algorithm; each has a limit on its costs."""

    steps_per_collection: int = 64
    """Steps between two rounds of learning, all environments together; at least one of each environment."""
    updates_per_step: float = 0.25
    """Gradient steps for each step; what a round does not come to is carried over."""
    steps_per_update: int = 2048
    """Steps between two reports, all environments together: then the multipliers move, and metrics are logged."""
    multiplier_rate: float = 0.5
    """Step size of the part of λ that integrates; K_I of a PID multiplier. λ is the reward that a unit of cost is
    worth."""
    multiplier_gain: float = 1.0
    """K_P: what is added to λ for each unit by which the mean cost exceeds the limit, at once; 0 for none."""
    multiplier_max: float = 50.0
    """Upper bound of λ."""
    multiplier_schedule: Schedule = "report"
    """When the multipliers move: once a report, from the episodes finished since the last one; or at each gradient
    step, as in OmniSafe, where an old mean is answered to again and again."""
    random_steps: int = 1000
    """Steps of uniformly drawn actions before the policy acts and anything is learnt."""
    replay_size: int = 1_000_000
    """Steps that are remembered."""
    minibatch: int = 256
    """Remembered steps of one gradient step."""
    discount: float = 0.99
    """γ of the reward."""
    cost_discount: float = 0.99
    """γ of the costs."""
    target_rate: float = 0.01
    """τ: how far the slow copies move towards the networks each time that the policy is improved."""
    policy_delay: int = 1
    """Gradient steps of the critics for one of the policy."""
    learning_rate: float = 1e-3
    """Adam's, for the policy."""
    critic_learning_rate: float = 1e-3
    """Adam's, for the critics."""
    linear_decay: bool = True
    """Whether the policy's learning rate falls linearly to 0 over the run, so that what remains at its end does not
    depend on where a swing is cut off."""
    max_grad_norm: float = 40.0
    """Longer gradients are shortened to this, the policy's and that of all critics each by itself."""
    cost_critics: int = 1
    """Critics of each cost: of two, targets take the larger estimate, as they take the smaller of two of the reward."""
    cost_floor: bool = True
    """Whether targets take a cost's critic at no less than 0, as no cost is negative. A policy seeks out where its cost
    is underestimated; without a floor what it finds goes into the targets, and so on without end."""
    normalise_cost: bool = False
    """Whether critics learn each cost's deviation from its running mean, in deviations and within ±5, as in OmniSafe:
    then a step without cost earns something, and a multiplier weighs another unit. The limit holds for raw costs."""
    hidden: tuple[int, ...] = (256, 256)
    """Sizes of the hidden layers, of the policy and of each critic."""
    activation: Activation = "relu"
    """Of the hidden layers."""
    initial: Initial = "orthogonal"
    """How weights start: orthogonal with a last layer of the policy near zero ("orthogonal"); uniform as
    torch's own layers ("kaiming"); or normal, cut off at two deviations ("truncated")."""
    normalise_observations: bool = True
    """Whether observations are standardised by running statistics: remembered ones by those of today."""
    adapter: Adapter = "native"
    """Discrete actions as choices ("native"), or as numbers that are rounded ("box_literal", "box_scaled")."""
    frame_stack: int = 1
    """How many of the last observations are seen side by side."""

    def __post_init__(self) -> None:
        require(self, self.conditions())

    def conditions(self) -> dict[str, tuple[bool, str]]:
        """What must hold of each field, in words."""
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
    def shape(self) -> Shape:
        """Of the networks."""
        return Shape(self.hidden, self.activation, self.initial)
