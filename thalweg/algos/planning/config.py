"""Settings that all planners share."""

import math
from dataclasses import dataclass
from typing import Literal

from thalweg.algos.common.settings import require
from thalweg.algos.constraint.cost_limits import CostConfig
from thalweg.algos.policy.actions import Adapter

Size = Literal["lite", "full"]
Precision = Literal["float32", "bfloat16"]
CostOver = Literal["mean", "max"]
Fitting = Literal["steady", "refit"]


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


@dataclass(frozen=True)
class PlanningConfig(CostConfig):
    """Settings that all planners share."""

    size: Size = "lite"
    """Preset for the settings below that are 0: "lite", or "full" as published."""
    samples: int = 0
    """Candidates per iteration; 0: as in `size`."""
    particles: int = 0
    """Imagined rollouts of each candidate in each model of the ensemble; 0: as in `size`."""
    iterations: int = 0
    """Updates of the plan per decision; 0: as in `size`."""
    elites: int = 0
    """Candidates that determine the next iteration, and the least number that must be feasible; 0: as in `size`."""
    model_hidden: tuple[int, ...] = ()
    """Sizes of the hidden layers of each model; empty: as in `size`."""
    horizon: int = 0
    """H: decisions that are imagined ahead; 0: as in `size`."""
    planning_discount: float = 0.99
    """γ of the reward within the horizon."""
    discount: float = 0.99
    """γ of the critics, for the reward after the horizon."""
    momentum: float = 0.1
    """Weight of the previous plan in each update."""
    floor: float = 0.02
    """Least probability of each option in a plan."""
    carry_over: float = 0.5
    """Weight of the previous decision's plan, shifted by a step, in the initial plan of the next decision; discrete
    actions only."""
    settled_variance: float = 0.0
    """The search ends early, after at least one iteration, once no variance of the plan is above this: that of a
    number, or p (1 - p) of an option. 0: it runs all iterations."""
    initial_std: float = 0.5
    """Standard deviation of continuous actions, which lie in -1..1, in the initial plan."""
    largest_variance: float = 4.0
    """Upper bound of the variance of continuous actions in a plan."""
    exploration: float = 0.2
    """Share of decisions in training that are sampled from the plan; the others take its most probable action."""
    action_repeat: int = 1
    """Environment steps that each decision is repeated for."""
    episode_length: int = 0
    """Steps of an episode over which the cost limit is spread; 0: measured."""
    cost_over: CostOver = "mean"
    """Whether the cost of a step is the mean or the maximum over its imagined rollouts."""
    shared_noise: bool = True
    """Whether all candidates share the same noise in imagined rollouts, which makes their comparison less noisy."""
    predict_end: bool = True
    """Whether imagined episodes can terminate as the model predicts; else all of them last H steps."""
    members: int = 5
    """Models in the ensemble."""
    model_learning_rate: float = 1e-3
    """Learning rate of Adam for the ensemble."""
    model_decay: float = 1e-4
    """Weight decay of each model's last layer; it falls to a quarter towards the first layer."""
    fixed_variance_bounds: bool = False
    """Whether the bounds of the predicted log-variance stay at their initial values, as in OmniSafe."""
    rarity: float = 10.0
    """Largest weight of a rare termination or cost relative to its absence in fitting; predictions stay unbiased."""
    fitting: Fitting = "steady"
    """"steady": `model_steps` gradient steps per collection. "refit": every `refit_steps` steps, over the whole replay
    buffer until the held-out loss stops improving."""
    model_steps: int = 64
    """Gradient steps of the ensemble per collection with "steady"."""
    refit_steps: int = 1200
    """Steps between refits."""
    refit_patience: int = 5
    """A refit stops after this number of epochs without an improvement of 1 % of the held-out loss."""
    hold_out: float = 0.05
    """Share of the steps that are held out of fitting to measure the model; at most a half."""
    minibatch: int = 256
    """Steps in the batch of one gradient step, for each model and for the critics."""
    hidden: tuple[int, ...] = (64, 64)
    """Sizes of the hidden layers of critics and actor."""
    critic_learning_rate: float = 1e-3
    """Learning rate of Adam for the critics."""
    critic_steps: int = 64
    """Gradient steps of the critics per collection."""
    critics_wait: bool = False
    """Whether critics (and an actor) start to learn only when planning starts, as in OmniSafe."""
    target_rate: float = 0.005
    """How far the target critics move towards the critics at each gradient step."""
    steps_per_collection: int = 256
    """Steps between two fits of the model, all environments together."""
    steps_per_update: int = 2048
    """Steps between two reports, all environments together."""
    random_steps: int = 2048
    """Steps with uniformly random actions before planning starts."""
    replay_size: int = 1_000_000
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
    frame_stack: int = 1
    """Number of the last observations that are stacked; the model predicts the newest. Not with an `action_repeat`: the
    model sees no frames between two decisions."""

    def __post_init__(self) -> None:
        require(self, self.conditions())

    def sized(self) -> Sizes:
        """The sizes that `size` stands for; each planner defines its own."""
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

    def conditions(self) -> dict[str, tuple[bool, str]]:
        """Condition and message for each field."""
        positive = ("action_repeat", "members", "refit_steps", "refit_patience", "minibatch")
        positive += ("steps_per_collection", "steps_per_update", "replay_size", "initial_std", "largest_variance")
        positive += ("target_rate",)
        natural = (
            "horizon",
            "samples",
            "particles",
            "iterations",
            "elites",
            "episode_length",
            "model_steps",
            "critic_steps",
        )
        natural += ("settled_variance", "random_steps", "model_learning_rate", "critic_learning_rate", "model_decay")
        shares = ("discount", "planning_discount", "momentum", "floor", "carry_over", "exploration", "target_rate")
        sizes = self.sizes
        return (
            self.cost_conditions()
            | {name: (getattr(self, name) > 0, "must be positive") for name in positive}
            | {name: (getattr(self, name) >= 0, "must not be negative") for name in natural}
            | {name: (0 <= getattr(self, name) <= 1, "must be in 0..1") for name in shares}
            | {
                "cost_limit": (
                    0 < self.cost_limit < math.inf,
                    "must be positive and finite: a predicted chance is never 0",
                ),
                "cost_limits": (
                    len(self.cost_limits) in (0, 2) and all(0 < limit < math.inf for limit in self.cost_limits),
                    "are two, tight and loose, positive and finite: a predicted chance is never 0",
                ),
                "elites": (0 < sizes.elites <= sizes.samples, f"must be in 1..{sizes.samples}, the samples"),
                "rarity": (self.rarity >= 1, "must be at least 1"),
                "hold_out": (0 < self.hold_out <= 0.5, "must be in 0..0.5, and more than 0"),
                "model_hidden": (all(size > 0 for size in self.model_hidden), "must be positive"),
                "hidden": (all(size > 0 for size in self.hidden), "must be positive"),
                "frame_stack": (
                    self.frame_stack == 1 or (self.frame_stack > 1 and self.action_repeat == 1),
                    "must be 1, or more without an action_repeat: the model sees no frames between two decisions",
                ),
            }
        )
