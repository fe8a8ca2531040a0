"""Settings that all planners share."""

from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import Field, NonNegativeInt, PositiveFloat, PositiveInt, model_validator

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.setting_types import LayerSize
from thalweg.algos.common.value_bounds import check_return_bounds
from thalweg.algos.constraint.cost_limits import CostConfig
from thalweg.algos.policy.actions import Adapter
from thalweg.core.config import FiniteNonNegative, FiniteNumber, FinitePositive, Fraction, Hint, TupleOf, frozen_config

Size = Literal["small", "lite", "full"]
Precision = Literal["float32", "bfloat16"]
CostOver = Literal["mean", "max"]
PlanBudget = Literal["share", "ends"]
Fitting = Literal["steady", "refit"]
CostLimit = Annotated[FinitePositive, Hint("a predicted chance is never 0")]


@dataclass(frozen=True)
class Sizes:
    """Amount of computation for one decision."""

    samples: int
    """S, candidates per iteration."""
    particles: int
    """P, imagined rollouts of each candidate in each model."""
    iterations: int
    """Updates of the plan."""
    elites: int
    """E, candidates that determine the next iteration, and the least number that must be feasible."""
    horizon: int
    """H, decisions that are imagined ahead."""
    model_hidden: tuple[int, ...]
    """Sizes of the hidden layers of each model."""


@frozen_config(AlgorithmError)
class PlanningConfig(CostConfig):
    """Settings that all planners share."""

    cost_limit: CostLimit = 0.1
    """Limit d on the mean cost of an episode."""
    cost_limits: TupleOf[CostLimit] = ()
    """Separate limits of the tight and the loose cost, in place of `cost_limit`."""
    size: Size = "small"
    """Preset for the settings below that are 0: "small", "lite", the default of earlier versions, or "full" as
    published."""
    samples: NonNegativeInt = 0
    """Candidates per iteration; 0: as in `size`."""
    particles: NonNegativeInt = 0
    """Imagined rollouts of each candidate in each model of the ensemble; 0: as in `size`."""
    iterations: NonNegativeInt = 0
    """Updates of the plan per decision; 0: as in `size`."""
    elites: NonNegativeInt = 0
    """Candidates that determine the next iteration, and the least number that must be feasible; 0: as in `size`."""
    model_hidden: TupleOf[LayerSize] = ()
    """Sizes of the hidden layers of each model; empty: as in `size`."""
    horizon: NonNegativeInt = 0
    """H: decisions that are imagined ahead; 0: as in `size`."""
    plan_budget: PlanBudget = "ends"
    """"share": a plan may have its horizon's share of the limit. "ends": the same of costs that leave the episode
    running, but the whole limit of those that end it, which are paid at most once."""
    planning_discount: Fraction = 0.97
    """γ of the reward within the horizon."""
    discount: Fraction = 0.97
    """γ of the critics, for the reward after the horizon. Plans differ by a few steps' rewards, and critics err by a
    share of the return: the shorter their horizon, the less their errors decide."""
    momentum: Fraction = 0.1
    """Weight of the previous plan in each update."""
    floor: Fraction = 0.02
    """Least probability of each option in a plan."""
    carry_over: Fraction = 0.5
    """Weight of the previous decision's plan, shifted by a step, in the initial plan of the next decision; discrete
    actions only."""
    settled_variance: FiniteNonNegative = 0.0
    """The search ends early, after at least one iteration, once no variance of the plan is above this: that of a
    number, or p (1 - p) of an option. 0: it runs all iterations."""
    initial_std: FinitePositive = 0.5
    """Standard deviation of continuous actions, which lie in -1..1, in the initial plan."""
    largest_variance: PositiveFloat = 4.0
    """Upper bound of the variance of continuous actions in a plan."""
    exploration: Fraction = 0.2
    """Share of decisions in training that are sampled from the plan; the others take its most probable action."""
    action_repeat: PositiveInt = 1
    """Environment steps that each decision is repeated for."""
    episode_length: NonNegativeInt = 0
    """Steps of an episode over which the cost limit is spread; 0: measured."""
    cost_over: CostOver = "mean"
    """Whether the cost of a step is the mean or the maximum over its imagined rollouts."""
    shared_noise: bool = True
    """Whether all candidates share the same noise in imagined rollouts, which makes their comparison less noisy."""
    predict_end: bool = True
    """Whether imagined episodes can terminate as the model predicts; else all of them last H steps."""
    members: PositiveInt = 5
    """Models in the ensemble."""
    model_learning_rate: FiniteNonNegative = 1e-3
    """Learning rate of Adam for the ensemble."""
    model_decay: FiniteNonNegative = 1e-4
    """Weight decay of each model's last layer; it falls to a quarter towards the first layer."""
    fixed_variance_bounds: bool = False
    """Whether the bounds of the predicted log-variance stay at their initial values, as in OmniSafe."""
    rarity: Annotated[float, Field(ge=1)] = 10.0
    """Largest weight of a rare termination or cost relative to its absence in fitting; predictions stay unbiased."""
    fitting: Fitting = "steady"
    """"steady": `model_steps` gradient steps per collection. "refit": every `refit_steps` steps, over the whole replay
    buffer until the held-out loss stops improving."""
    model_steps: NonNegativeInt = 64
    """Gradient steps of the ensemble per collection with "steady"."""
    refit_steps: PositiveInt = 1200
    """Steps between refits."""
    refit_patience: PositiveInt = 5
    """A refit stops after this number of epochs without an improvement of 1 % of the held-out loss."""
    hold_out: Annotated[float, Field(gt=0, le=0.5)] = 0.05
    """Share of the steps that are held out of fitting to measure the model; at most a half."""
    minibatch: PositiveInt = 256
    """Steps in the batch of one gradient step, for each model and for the critics."""
    hidden: TupleOf[LayerSize] = (64, 64)
    """Sizes of the hidden layers of critics and actor."""
    bound_targets: bool = True
    """Whether the values that the critics' targets add to a reward are held within what an episode can pay from a step
    on: within `return_bounds`, or within learnt bounds where the task's are not given."""
    return_bounds: TupleOf[FiniteNumber] = ()
    """Smallest and largest discounted return of the task from any step on; none: learnt, the extremes of all episodes
    so far, widened by `bound_margin`."""
    bound_margin: FiniteNonNegative = 0.5
    """Widening of learnt bounds on either side, as a share of the distance between them."""
    critic_learning_rate: FiniteNonNegative = 1e-3
    """Learning rate of Adam for the critics."""
    critic_steps: NonNegativeInt = 64
    """Gradient steps of the critics per collection."""
    critics_wait: bool = False
    """Whether critics (and an actor) start to learn only when planning starts, as in OmniSafe."""
    target_rate: Annotated[float, Field(gt=0, le=1)] = 0.005
    """How far the target critics move towards the critics at each gradient step."""
    steps_per_collection: PositiveInt = 256
    """Steps between two fits of the model, all environments together."""
    steps_per_update: PositiveInt = 2048
    """Steps between two reports, all environments together."""
    random_steps: NonNegativeInt = 2048
    """Steps with uniformly random actions before planning starts."""
    replay_size: PositiveInt = 1_000_000
    """Steps that the replay buffer holds; the oldest are overwritten."""
    drop_terminal: bool = False
    """Whether the last step of each episode is discarded, as in OmniSafe; a cost at the end of an episode is then never
    learnt."""
    precision: Precision = "float32"
    """Precision of matrix products in imagined rollouts; sums and states are always float32."""
    normalise_observations: bool = True
    """Whether observations are standardised by running statistics."""
    adapter: Adapter = "native"
    """Discrete actions as choices ("native"), or as numbers that are rounded ("box_literal", "box_scaled")."""
    frame_stack: PositiveInt = 1
    """Number of the last observations that are stacked; the model predicts the newest. Not with an `action_repeat`: the
    model sees no frames between two decisions."""

    @model_validator(mode="after")
    def _elites_are_samples(self) -> Self:
        if not 0 < self.sizes.elites <= self.sizes.samples:
            raise ValueError(f"elites must be from 1 to {self.sizes.samples}, the samples, got {self.sizes.elites}")
        return self

    @model_validator(mode="after")
    def _bounds_are_ordered(self) -> Self:
        check_return_bounds(self.return_bounds)
        return self

    @model_validator(mode="after")
    def _stacked_frames_are_all_seen(self) -> Self:
        if self.frame_stack > 1 and self.action_repeat > 1:
            raise ValueError(
                f"frame_stack must be 1 with an action_repeat, got {self.frame_stack}: "
                "the model sees no frames between two decisions"
            )
        return self

    def rollout_steps(self, num_envs: int) -> int:
        """Return T, the steps of each environment between two fits of the model."""
        return max(1, self.steps_per_collection // num_envs)

    def sized(self) -> Sizes:
        """Return the sizes that `size` stands for; each planner defines its own."""
        raise NotImplementedError

    @property
    def sizes(self) -> Sizes:
        """The sizes in use: the given ones, else those of `size`."""
        given = self.sized()
        return Sizes(
            self.samples or given.samples,
            self.particles or given.particles,
            self.iterations or given.iterations,
            self.elites or given.elites,
            self.horizon or given.horizon,
            self.model_hidden or given.model_hidden,
        )
