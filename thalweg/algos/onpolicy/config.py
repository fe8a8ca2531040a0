"""Settings that on-policy algorithms share: all of them, first-order, natural-step and constrained ones."""

from dataclasses import dataclass

from thalweg.algos.common.settings import require
from thalweg.algos.constraint.cost_limits import CostConfig, MeanCostConfig
from thalweg.algos.policy.actions import Adapter
from thalweg.algos.policy.memory import Memory
from thalweg.algos.policy.mlp import Initial
from thalweg.algos.policy.mlp_autograd import Activation
from thalweg.algos.policy.networks import NetworkShape


@dataclass(frozen=True)
class OnPolicyConfig:
    """Settings of every on-policy algorithm."""

    steps_per_update: int = 2048
    """Environment steps between two updates, summed over all environments; at least two per environment."""
    passes: int = 10
    """Largest number of passes over the rollout per update; OnCRPO and CPO use it for the critics only."""
    minibatch: int = 256
    """Approximate number of environment steps per gradient step."""
    critic_learning_rate: float = 1e-3
    """Learning rate of Adam for the critics."""
    discount: float = 0.99
    """Discount factor γ of the reward."""
    trace: float = 0.95
    """λ of generalised advantage estimation for the reward."""
    max_grad_norm: float = 1.0
    """Largest norm of a gradient; the gradients of the policy and of the critics are clipped separately."""
    critic_decay: float = 0.0
    """L2 regularisation of the critics: weight of their squared parameters, added to half their mean squared error."""
    hidden: tuple[int, ...] = (64, 64)
    """Sizes of the hidden layers of the policy and of each critic."""
    activation: Activation = "tanh"
    """Activation function of the hidden layers."""
    initial: Initial = "orthogonal"
    """Initial weights: "orthogonal", with a last layer of the policy near zero; "kaiming", uniform as in torch's own
    layers; or "truncated", normal and cut off at two standard deviations."""
    normalise_observations: bool = True
    """Whether observations are standardised by running statistics."""
    adapter: Adapter = "native"
    """How discrete actions are learnt: as categorical choices ("native"), or as Gaussian numbers that are rounded to
    options ("box_literal", "box_scaled")."""
    frame_stack: int = 1
    """Number of last observations that are concatenated."""
    memory: Memory = "none"
    """Recurrent memory: with "gru", a recurrent network precedes the policy and another one the critics."""
    memory_size: int = 64
    """Size of the recurrent state."""
    sequence: int = 16
    """Steps of backpropagation through time."""
    reset_each_update: bool = False
    """Whether all environments are reset after each update, as in OmniSafe; the unfinished episodes are not counted."""

    def __post_init__(self) -> None:
        require(self, self.conditions())

    def conditions(self) -> dict[str, tuple[bool, str]]:
        """Return, for each field, whether its condition holds and the condition in words."""
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
        """Shape of the networks."""
        memory = self.memory_size if self.memory == "gru" else 0
        return NetworkShape(self.hidden, self.activation, self.initial, memory)


@dataclass(frozen=True)
class FirstOrderConfig(OnPolicyConfig):
    """Settings of every on-policy algorithm whose policy is trained by Adam."""

    target_kl: float = 0.02
    """Passes stop once the mean KL from the policy that collected the rollout exceeds this, in nats, summed over action
    branches."""
    learning_rate: float = 1e-3
    """Learning rate of Adam for the policy."""
    linear_decay: bool = True
    """Whether the policy's learning rate decays linearly to 0 over the run."""
    entropy: float = 0.003
    """Coefficient of the policy's entropy (nats, summed over action branches) in the loss."""

    def conditions(self) -> dict[str, tuple[bool, str]]:
        return super().conditions() | {
            "target_kl": (self.target_kl > 0, "must be positive (inf: never stop early)"),
            "learning_rate": (self.learning_rate >= 0, "must not be negative"),
            "entropy": (self.entropy >= 0, "must not be negative"),
        }


@dataclass(frozen=True)
class NaturalConfig(OnPolicyConfig):
    """Settings of every on-policy algorithm whose policy takes one natural-gradient step per update."""

    trust_radius: float = 0.02
    """Trust region δ: the largest mean KL of one step, in nats, summed over action branches."""
    radius_settles: bool = True
    """Whether δ decays to 0 over the last quarter of the run, so that a policy that oscillates about its limit does not
    end at an arbitrary point of the oscillation."""
    kl_per_dimension: bool = False
    """Whether that KL is averaged over the action dimensions A too, as in OmniSafe, which allows A times as large a
    step."""
    conjugate_iterations: int = 15
    """Iterations of the conjugate gradient method that solves for the step."""
    damping: float = 0.1
    """Damping: multiple of the identity that is added to the Fisher matrix."""
    backtracks: int = 15
    """Largest number of steps that the line search tries; if none is accepted, the policy stays."""
    backtrack_factor: float = 0.8
    """Factor by which each step of the line search is shorter than the one before."""

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
    """Settings of the costs of every on-policy algorithm with a cost limit."""

    cost_discount: float = 0.99
    """Discount factor γ of the cost."""
    cost_trace: float = 0.95
    """λ of generalised advantage estimation for the cost."""
    standardise_cost: bool = True
    """Whether a cost's advantages are divided by their standard deviation, so that the multiplier weighs quantities of
    the same scale; otherwise they are only centred."""

    def cost_conditions(self) -> dict[str, tuple[bool, str]]:
        return (
            super().cost_conditions()
            | self.window_conditions()
            | {
                "cost_discount": (0 <= self.cost_discount <= 1, "must be in 0..1"),
                "cost_trace": (0 <= self.cost_trace <= 1, "must be in 0..1"),
            }
        )
