"""Settings that on-policy algorithms share: all of them, first-order, natural-step and constrained ones."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, model_validator

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.setting_types import LayerSize
from thalweg.algos.constraint.cost_limits import CostConfig, MeanCostConfig, Multiple
from thalweg.algos.constraint.multiplier import MultiplierConfig
from thalweg.algos.policy.actions import Adapter
from thalweg.algos.policy.memory import Memory
from thalweg.algos.policy.mlp import Initial
from thalweg.algos.policy.mlp_autograd import Activation
from thalweg.algos.policy.networks import NetworkShape
from thalweg.algos.policy.vision import Eyes
from thalweg.core.config import FiniteNonNegative, FinitePositive, Fraction, Hint, TupleOf, frozen_config


@frozen_config(AlgorithmError)
class OnPolicyConfig:
    """Settings of every on-policy algorithm."""

    steps_per_update: PositiveInt = 2048
    """Environment steps between two updates, summed over all environments; at least two per environment."""
    passes: PositiveInt = 10
    """Largest number of passes over the rollout per update; OnCRPO and CPO use it for the critics only."""
    minibatch: PositiveInt = 256
    """Approximate number of environment steps per gradient step."""
    critic_learning_rate: FiniteNonNegative = 1e-3
    """Learning rate of Adam for the critics."""
    discount: Fraction = 0.99
    """Discount factor γ of the reward."""
    trace: Fraction = 0.95
    """λ of generalised advantage estimation for the reward."""
    max_grad_norm: PositiveFloat = 1.0
    """Largest norm of a gradient; the gradients of the policy and of the critics are clipped separately."""
    critic_decay: FiniteNonNegative = 0.0
    """L2 regularisation of the critics: weight of their squared parameters, added to half their mean squared error."""
    policy: Literal["mlp", "cnn"] = "mlp"
    """What the policy sees: numbers ("mlp"), or images by convolutions of its own, and its last action ("cnn"). With
    "cnn" the critics see only what the environment tells them beyond the observation, and have no memory."""
    filters: TupleOf[LayerSize] = (16, 32, 64, 64)
    """With policy=cnn: filters of each convolution."""
    features: LayerSize = 256
    """With policy=cnn: numbers that the convolutions make of an image."""
    hidden: TupleOf[LayerSize] = (64, 64)
    """Sizes of the hidden layers of the policy and of each critic."""
    activation: Activation = "tanh"
    """Activation function of the hidden layers."""
    initial: Initial = "orthogonal"
    """Initial weights: "orthogonal", with a last layer of the policy near zero; "kaiming", uniform as in torch's own
    layers; or "truncated", normal and cut off at two standard deviations."""
    normalise_observations: bool = True
    """Whether observations, and what only critics see, are standardised by running statistics."""
    asymmetric_critics: bool = False
    """Whether critics also see what the environment tells them beyond the observation (`info["critic_obs"]`), such as
    the privileged state and progress; the policy does not (Pinto et al. 2018)."""
    critic_warmup_steps: NonNegativeInt = 10_000
    """With `begin_with`: environment steps during which only the critics learn, because critics that have learnt
    nothing would move the policy anywhere; without it, no effect. Policy and multipliers stay until then. Above 16
    environments the default is 625 steps of each, enough for an episode of 500."""
    imitation_kl: FiniteNonNegative = 0.0
    """With `begin_with`: weight of the KL from the policy that the run begins with, KL(π ‖ π_0) in nats, summed over
    action branches, in the policy's loss or, of natural gradients, in their objective; that at the beginning."""
    imitation_kl_share: Annotated[float, Field(gt=0, le=1)] = 0.5
    """Share of the run over which that weight falls linearly to 0."""
    adapter: Adapter = "native"
    """How discrete actions are learnt: as categorical choices ("native"), or as Gaussian numbers that are rounded to
    options ("box_literal", "box_scaled")."""
    frame_stack: PositiveInt = 1
    """Number of last observations that are concatenated."""
    memory: Memory = "none"
    """Recurrent memory: with "gru", a recurrent network precedes the policy and another one the critics."""
    memory_size: LayerSize = 64
    """Size of the recurrent state."""
    sequence: PositiveInt = 16
    """Steps of backpropagation through time."""
    reset_each_update: bool = False
    """Whether all environments are reset after each update, as in OmniSafe; the unfinished episodes are not counted."""

    @model_validator(mode="after")
    def _eyes_see_one_frame(self) -> Self:
        if self.policy == "cnn" and self.frame_stack > 1:
            raise ValueError(f"frame_stack must be 1 with policy=cnn, got {self.frame_stack}: use memory=gru")
        return self

    @property
    def sees_images(self) -> bool:
        """Whether the policy sees images."""
        return self.policy == "cnn"

    @property
    def told_critics(self) -> bool:
        """Whether critics see what the environment tells them beyond the observation."""
        return self.asymmetric_critics or self.sees_images

    @property
    def warmup_steps(self) -> int:
        """Steps during which only critics learn, in a run that begins with another policy."""
        return self.critic_warmup_steps

    def rollout_steps(self, num_envs: int) -> int:
        """Return T, the steps of each environment between two updates."""
        return max(2, self.steps_per_update // num_envs)

    def shape(self, image: tuple[int, int, int] | None = None) -> NetworkShape:
        """Return the shape of the policy's network, for images [H, W, C] with policy=cnn."""
        memory = self.memory_size if self.memory == "gru" else 0
        eyes = None if image is None else Eyes(image, self.filters, self.features)
        return NetworkShape(self.hidden, self.activation, self.initial, memory, eyes)

    @property
    def critic_shape(self) -> NetworkShape:
        """Shape of the critics' networks."""
        memory = self.memory_size if self.memory == "gru" and not self.sees_images else 0
        return NetworkShape(self.hidden, self.activation, self.initial, memory)

    def imitation_weight(self, progress: float) -> float:
        """Return the weight of the KL from the policy that a run begins with, after this share of it, 0..1."""
        return self.imitation_kl * max(0.0, 1.0 - progress / self.imitation_kl_share)


def settings_like(shape: NetworkShape) -> dict[str, Any]:
    """Return the settings with which a policy that sees images has a shape; empty for a shape without eyes."""
    if shape.eyes is None:
        return {}
    memory = {"memory": "gru", "memory_size": shape.memory} if shape.memory else {"memory": "none"}
    eyes = {"filters": shape.eyes.filters, "features": shape.eyes.features}
    return {"hidden": shape.hidden, "activation": shape.activation, **memory, **eyes}


@frozen_config(AlgorithmError)
class FirstOrderConfig(OnPolicyConfig):
    """Settings of every on-policy algorithm whose policy is trained by Adam."""

    target_kl: Annotated[float, Field(gt=0), Hint("inf: never stop early")] = 0.02
    """Passes stop once the mean KL from the policy that collected the rollout exceeds this, in nats, summed over action
    branches."""
    learning_rate: FiniteNonNegative = 1e-3
    """Learning rate of Adam for the policy."""
    linear_decay: bool = True
    """Whether the policy's learning rate decays linearly to 0 over the run."""
    entropy: FiniteNonNegative = 0.003
    """Coefficient of the policy's entropy (nats, summed over action branches) in the loss."""


@frozen_config(AlgorithmError)
class NaturalConfig(OnPolicyConfig):
    """Settings of every on-policy algorithm whose policy takes one natural-gradient step per update."""

    trust_radius: FinitePositive = 0.02
    """Trust region δ: the largest mean KL of one step, in nats, summed over action branches."""
    radius_settles: bool = True
    """Whether δ decays to 0 over the last quarter of the run, so that a policy that oscillates about its limit does not
    end at an arbitrary point of the oscillation."""
    kl_per_dimension: bool = False
    """Whether that KL is averaged over the action dimensions A too, as in OmniSafe, which allows A times as large a
    step."""
    conjugate_iterations: PositiveInt = 15
    """Iterations of the conjugate gradient method that solves for the step."""
    curvature_steps: NonNegativeInt = 0
    """Largest number of steps of the rollout from which the Fisher matrix is computed; 0: all of them."""
    damping: FiniteNonNegative = 0.1
    """Damping: multiple of the identity that is added to the Fisher matrix."""
    backtracks: PositiveInt = 15
    """Largest number of steps that the line search tries; if none is accepted, the policy stays."""
    backtrack_factor: Annotated[float, Field(gt=0, lt=1)] = 0.8
    """Factor by which each step of the line search is shorter than the one before."""


@frozen_config(AlgorithmError)
class ConstrainedConfig(CostConfig, MeanCostConfig):
    """Settings of the costs of every on-policy algorithm with a cost limit."""

    cost_limit_schedule: TupleOf[Multiple] = (12.0,)
    """Limits at the beginning of the run, as multiples of the final ones: one number for all costs, or one for each.
    They tighten linearly, and at once when the mean cost of fifty episodes in a row has met the final limit, above 16
    environments that of three episodes of each. Empty: limits stay the same. A limit that idling exceeds teaches a
    beginner to avoid costs before it has seen what flying pays."""
    cost_limit_share: Annotated[float, Field(gt=0, le=1)] = 0.6
    """Share of the run after which limits with a schedule have tightened to the final ones."""
    cost_discount: Fraction = 0.99
    """Discount factor γ of the cost."""
    cost_trace: Fraction = 0.95
    """λ of generalised advantage estimation for the cost."""
    standardise_cost: bool = True
    """Whether a cost's advantages are divided by their standard deviation, so that the multiplier weighs quantities of
    the same scale; otherwise they are only centred."""


@frozen_config(AlgorithmError)
class LagrangianConfig(MultiplierConfig, ConstrainedConfig, FirstOrderConfig):
    """Settings of every on-policy algorithm with multipliers."""

    multiplier_max: NonNegativeFloat = 2.0
    """Upper bound of λ."""
