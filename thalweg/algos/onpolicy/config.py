"""Which settings do all on-policy algorithms have, and which those with a cost limit?"""

from dataclasses import dataclass

from thalweg.algos.common.settings import require
from thalweg.algos.constraint.cost_limits import CostConfig, MeanCostConfig
from thalweg.algos.policy.actions import Adapter
from thalweg.algos.policy.memory import Memory
from thalweg.algos.policy.mlp_autograd import Activation
from thalweg.algos.policy.networks import Initial, NetworkShape


@dataclass(frozen=True)
class OnPolicyConfig:
    """Settings of every on-policy algorithm."""

    steps_per_update: int = 2048
    """Steps between updates, all environments together; two of each environment at least."""
    passes: int = 10
    """How often an update goes through its steps, at most; where the policy takes a single step, the critics alone."""
    minibatch: int = 256
    """Steps of one gradient step, about."""
    critic_learning_rate: float = 1e-3
    """Adam's, for the critics."""
    discount: float = 0.99
    """γ of the reward."""
    trace: float = 0.95
    """λ of generalised advantage estimation, of the reward."""
    max_grad_norm: float = 1.0
    """Longer gradients are shortened to this, the policy's and the critics' each by itself."""
    critic_decay: float = 0.0
    """Weight of the critics' squared parameters beside half their mean squared error."""
    hidden: tuple[int, ...] = (64, 64)
    """Sizes of the hidden layers, of the policy and of each critic."""
    activation: Activation = "tanh"
    """Of the hidden layers."""
    initial: Initial = "orthogonal"
    """How weights start: orthogonal with a last layer of the policy near zero ("orthogonal"); uniform as
    torch's own layers ("kaiming"); or normal, cut off at two deviations ("truncated")."""
    normalise_observations: bool = True
    """Whether observations are standardised by running statistics."""
    adapter: Adapter = "native"
    """Discrete actions as choices ("native"), or as a Gaussian that is rounded ("box_literal", "box_scaled")."""
    frame_stack: int = 1
    """How many of the last observations are seen side by side."""
    memory: Memory = "none"
    """"gru": policy and critics have a recurrent network each in front."""
    memory_size: int = 64
    """Numbers of the recurrent state."""
    sequence: int = 16
    """Steps that a gradient goes back through the recurrent network."""
    reset_each_update: bool = False
    """Whether all episodes are cut off after each update, and count for nothing, as in OmniSafe."""

    def __post_init__(self) -> None:
        require(self, self.conditions())

    def conditions(self) -> dict[str, tuple[bool, str]]:
        """What must hold of each field, in words."""
        return {
            "steps_per_update": (self.steps_per_update > 0, "must be positive"),
            "passes": (self.passes > 0, "must be positive"),
            "minibatch": (self.minibatch > 0, "must be positive"),
            "critic_learning_rate": (self.critic_learning_rate >= 0, "must not be negative"),
            "discount": (0 <= self.discount <= 1, "must be in 0..1"),
            "trace": (0 <= self.trace <= 1, "must be in 0..1"),
            "max_grad_norm": (self.max_grad_norm > 0, "must be positive"),
            "hidden": (all(size > 0 for size in self.hidden), "must be positive"),
            "critic_decay": (self.critic_decay >= 0, "must not be negative"),
            "frame_stack": (self.frame_stack > 0, "must be positive"),
            "memory_size": (self.memory_size > 0, "must be positive"),
            "sequence": (self.sequence > 0, "must be positive"),
        }

    @property
    def shape(self) -> NetworkShape:
        """Of the networks."""
        memory = self.memory_size if self.memory == "gru" else 0
        return NetworkShape(self.hidden, self.activation, self.initial, memory)


@dataclass(frozen=True)
class FirstOrderConfig(OnPolicyConfig):
    """Settings of every on-policy algorithm whose policy learns by Adam."""

    target_kl: float = 0.02
    """No further pass once the policy is this far from the one that acted: mean KL of all branches together, in
    nats."""
    learning_rate: float = 1e-3
    """Adam's, for the policy."""
    linear_decay: bool = True
    """Whether the policy's learning rate falls linearly to 0 over the run."""
    entropy: float = 0.003
    """Weight of the policy's entropy (nats, summed over branches) in the loss."""

    def conditions(self) -> dict[str, tuple[bool, str]]:
        return super().conditions() | {
            "target_kl": (self.target_kl > 0, "must be positive (inf: never stop early)"),
            "learning_rate": (self.learning_rate >= 0, "must not be negative"),
            "entropy": (self.entropy >= 0, "must not be negative"),
        }


@dataclass(frozen=True)
class NaturalConfig(OnPolicyConfig):
    """Settings of every on-policy algorithm whose policy takes one natural step an update."""

    trust_radius: float = 0.02
    """δ: how far one step may move the policy: mean KL of all branches together, in nats."""
    radius_settles: bool = True
    """Whether δ falls to nothing over the last quarter of the run, so that what remains of a policy that swings about a
    limit does not depend on where the swing is cut off."""
    kl_per_dimension: bool = False
    """Whether that KL is a mean over the action's numbers too, as in OmniSafe, so that it allows as many times more."""
    conjugate_iterations: int = 15
    """Of the conjugate gradient that solves for the step."""
    damping: float = 0.1
    """Added to the Fisher matrix, as this multiple of the identity."""
    backtracks: int = 15
    """Steps tried at most, each shorter than the one before; if none will do, the policy stays."""
    backtrack_factor: float = 0.8
    """How much shorter."""

    def conditions(self) -> dict[str, tuple[bool, str]]:
        return super().conditions() | {
            "trust_radius": (self.trust_radius > 0, "must be positive"),
            "conjugate_iterations": (self.conjugate_iterations > 0, "must be positive"),
            "damping": (self.damping >= 0, "must not be negative"),
            "backtracks": (self.backtracks > 0, "must be positive"),
            "backtrack_factor": (0 < self.backtrack_factor < 1, "must be in 0..1"),
        }


@dataclass(frozen=True)
class ConstrainedConfig(CostConfig, MeanCostConfig):
    """Settings of every on-policy algorithm with a cost limit, beside the others."""

    cost_discount: float = 0.99
    """γ of the cost."""
    cost_trace: float = 0.95
    """λ of generalised advantage estimation, of the cost."""
    standardise_cost: bool = True
    """Whether a cost's advantage is divided by its own deviation, so that a multiplier compares like with like; else
    only centred."""

    def cost_conditions(self) -> dict[str, tuple[bool, str]]:
        return (
            super().cost_conditions()
            | self.window_conditions()
            | {
                "cost_discount": (0 <= self.cost_discount <= 1, "must be in 0..1"),
                "cost_trace": (0 <= self.cost_trace <= 1, "must be in 0..1"),
            }
        )
