"""Settings that all off-policy algorithms share."""

from typing import Annotated, Literal, Self

from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, model_validator

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.setting_types import LayerSize
from thalweg.algos.common.value_bounds import check_return_bounds
from thalweg.algos.constraint.cost_limits import CostConfig
from thalweg.algos.constraint.multiplier import MultiplierConfig
from thalweg.algos.offpolicy.value_scale import CostScale
from thalweg.algos.policy.actions import Adapter
from thalweg.algos.policy.mlp import Initial
from thalweg.algos.policy.mlp_autograd import Activation
from thalweg.algos.policy.networks import NetworkShape
from thalweg.core.config import FiniteNonNegative, FiniteNumber, FinitePositive, Fraction, TupleOf, frozen_config

Schedule = Literal["report", "gradient_step"]
"""When the multipliers are updated."""


@frozen_config(AlgorithmError)
class OffPolicyConfig(MultiplierConfig, CostConfig):
    """Settings that all off-policy algorithms share; each algorithm has a limit on its costs."""

    steps_per_collection: PositiveInt = 64
    """Steps between two rounds of learning, all environments together; at least one step of each environment."""
    updates_per_step: FinitePositive = 0.25
    """Gradient steps per environment step; a fraction that is left after a round is carried over to the next."""
    steps_per_update: PositiveInt = 2048
    """Steps between two reports, all environments together. At a report the multipliers are updated and metrics are
    logged."""
    multiplier_rate: FiniteNonNegative = 0.15
    """Step size of the integral part of λ; K_I of a PID multiplier. λ is the reward that one unit of cost is worth,
    both in the critics' units."""
    multiplier_gain: FiniteNonNegative = 0.5
    """K_P: added to λ at once for each unit of the violation; 0 for none."""
    multiplier_max: NonNegativeFloat = 3.0
    """Upper bound of λ. With `scale_returns` it is the number of deviations of the return that one unit of cost is
    worth at most (`cost_scale`); where an episode pays no more than that, no cost is worth risking, and the policy does
    nothing."""
    scale_returns: bool = True
    """Whether critics learn rewards and costs in units of their own: rewards divided by the running deviation of
    discounted returns, costs by the unit of `cost_scale`. Multipliers, α and `output_decay` then do not depend on the
    task's units. The replay buffer holds raw numbers, and limits apply to raw costs."""
    cost_scale: CostScale = "step"
    """Unit of a cost with `scale_returns`: the largest cost of a step so far ("step"), or the limit where that is
    greater ("limit"). Where an episode has many costs, the multiplier that holds a limit of many of them is small in
    the first unit; in the second its size depends on the task less."""
    bound_targets: bool = True
    """Whether the critics' targets are held within what an episode can pay and cost from a step on: within
    `return_bounds` and `largest_costs`, or within learnt bounds where the task's are not given."""
    return_bounds: TupleOf[FiniteNumber] = ()
    """Smallest and largest discounted return of the task from any step on; none: learnt, the extremes of all episodes
    so far, widened by `bound_margin`."""
    largest_costs: TupleOf[FiniteNonNegative] = ()
    """Largest discounted cost of the task from any step on, for each limit; none: learnt."""
    bound_margin: FiniteNonNegative = 0.5
    """Widening of learnt bounds on either side, as a share of the distance between them."""
    multiplier_schedule: Schedule = "report"
    """When the multipliers are updated: at each report, from the episodes finished since the last one ("report"), or at
    each gradient step, as in OmniSafe, which uses the same mean cost many times ("gradient_step")."""
    random_steps: NonNegativeInt = 1000
    """Steps with uniformly random actions before the policy acts and learning starts. With `begin_with` the policy acts
    in these steps too: random actions would fill the replay buffer with states that it never meets."""
    critic_warmup_steps: NonNegativeInt = 10_000
    """With `begin_with`: steps after `random_steps` during which only the critics learn; without it they do nothing.
    Critics that have learnt nothing would move the policy anywhere, and multipliers would act through them. It takes
    long, because values reach earlier states through slow target networks. Above 16 environments the default is 625
    steps of each."""
    replay_size: PositiveInt = 1_000_000
    """Steps that the replay buffer holds."""
    minibatch: PositiveInt = 128
    """Steps in the batch of one gradient step."""
    discount: Fraction = 0.97
    """γ of the reward. Actions differ in value by about a step's reward, and critics err by a share of the return: with
    rewards at every step, a shorter horizon lets a policy tell moving from waiting."""
    cost_discount: Fraction = 0.99
    """γ of the costs."""
    target_rate: Annotated[float, Field(gt=0, le=1)] = 0.01
    """τ: how far the target networks move towards the networks after each update of the policy."""
    policy_delay: PositiveInt = 1
    """Gradient steps of the critics per gradient step of the policy."""
    learning_rate: FiniteNonNegative = 1e-3
    """Learning rate of Adam for the policy."""
    critic_learning_rate: FiniteNonNegative = 1e-3
    """Learning rate of Adam for the critics."""
    linear_decay: bool = True
    """Whether the policy's learning rate falls linearly to 0 over the run, so that the final policy does not depend on
    the point of an oscillation at which training ends."""
    max_grad_norm: PositiveFloat = 40.0
    """Longer gradients are scaled down to this norm, the policy's and that of all critics separately."""
    cost_critics: Annotated[int, Field(ge=1, le=2)] = 1
    """Critics of each cost. With two, targets take the larger estimate; of the reward's two, the smaller."""
    cost_floor: bool = True
    """Whether targets clip a cost critic's estimate at 0, as no cost is negative. A policy finds actions whose cost is
    underestimated; without the floor these estimates enter the targets and the error grows without bound."""
    normalise_cost: bool = False
    """Whether critics learn each cost standardised by its running mean and standard deviation and clipped to ±5, as in
    OmniSafe. A step without cost then has a negative cost, and a multiplier weighs another unit. The limit applies to
    raw costs."""
    hidden: TupleOf[LayerSize] = (64, 64)
    """Sizes of the hidden layers, of the policy and of each critic."""
    activation: Activation = "relu"
    """Activation of the hidden layers."""
    initial: Initial = "orthogonal"
    """Initial weights: orthogonal, with a last layer of the policy near zero ("orthogonal"); uniform, as in torch's own
    layers ("kaiming"); or normal, truncated at two standard deviations ("truncated")."""
    asymmetric_critics: bool = False
    """Whether critics also see what the environment tells them beyond the observation (`info["critic_obs"]`), such as
    the privileged state and progress; the policy does not (Pinto et al. 2018)."""
    normalise_observations: bool = True
    """Whether observations, and what only critics see, are standardised by running statistics; stored ones by the
    current statistics."""
    adapter: Adapter = "native"
    """Discrete actions as choices ("native"), or as numbers that are rounded ("box_literal", "box_scaled")."""
    frame_stack: PositiveInt = 1
    """Number of the last observations that are stacked."""

    @model_validator(mode="after")
    def _cost_floor_needs_raw_costs(self) -> Self:
        if self.cost_floor and self.normalise_cost:
            raise ValueError("cost_floor must be off with normalise_cost, got True")
        if self.scale_returns and self.normalise_cost:
            raise ValueError("scale_returns must be off with normalise_cost, got True")
        if self.cost_scale == "limit" and not self.scale_returns:
            raise ValueError("cost_scale must be step without scale_returns, got limit")
        if self.largest_costs and self.normalise_cost:
            raise ValueError(f"largest_costs must be left out with normalise_cost, got {list(self.largest_costs)}")
        return self

    @model_validator(mode="after")
    def _bounds_are_ordered(self) -> Self:
        check_return_bounds(self.return_bounds)
        if self.largest_costs and len(self.largest_costs) != len(self.limits):
            raise ValueError(f"largest_costs must be {len(self.limits)}, one per limit, got {list(self.largest_costs)}")
        return self

    @property
    def warmup_steps(self) -> int:
        """Steps in which the policy does not learn, in a run that begins with another policy."""
        return self.random_steps + self.critic_warmup_steps

    def rollout_steps(self, num_envs: int) -> int:
        """Return T, the steps of each environment between two rounds of learning."""
        return max(1, self.steps_per_collection // num_envs)

    @property
    def shape(self) -> NetworkShape:
        """NetworkShape of the networks."""
        return NetworkShape(self.hidden, self.activation, self.initial)
