"""Which settings do all planners have?"""

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
    """How much is computed for a decision."""

    samples: int
    """S, candidates of an iteration."""
    particles: int
    """P, futures of each candidate in each model."""
    iterations: int
    elites: int
    """E, candidates that shape the next iteration, or the least that must be feasible."""
    horizon: int
    """H, decisions that are imagined ahead."""
    model_hidden: tuple[int, ...]


@dataclass(frozen=True)
class PlanningConfig(CostConfig):
    """Settings of every planner."""

    size: Size = "lite"
    """How much is computed where a setting below is 0: "full" is as published."""
    samples: int = 0
    """Candidates of an iteration; 0: as `size` says."""
    particles: int = 0
    """Imagined futures of each candidate in each model of the ensemble; 0: as `size` says."""
    iterations: int = 0
    """How often the plan is improved for a decision; 0: as `size` says."""
    elites: int = 0
    """Candidates that shape the next iteration, and the least that must be feasible; 0: as `size` says."""
    model_hidden: tuple[int, ...] = ()
    """Sizes of the hidden layers of each model; empty: as `size` says."""
    horizon: int = 0
    """H: decisions that are imagined ahead; 0: as `size` says."""
    planning_discount: float = 0.99
    """γ of the reward within the horizon."""
    discount: float = 0.99
    """γ of the reward beyond it: the critics'."""
    momentum: float = 0.1
    """Share of the plan before that an iteration keeps."""
    floor: float = 0.02
    """Least probability of each option in a plan."""
    carry_over: float = 0.5
    """Share of the last decision's plan, shifted by a step, in the first guess of the next; of options only."""
    settled_variance: float = 0.0
    """The search for a decision ends early, after at least one iteration, once no variance of its plan is above this:
    that of a number, or p (1 - p) of an option. 0: it takes all iterations."""
    initial_std: float = 0.5
    """Deviation of numbers, which lie in -1..1, in the first guess."""
    largest_variance: float = 4.0
    """Upper bound of the variance of numbers in a plan."""
    exploration: float = 0.2
    """Share of training's decisions that are drawn from the plan, instead of being its most probable action."""
    action_repeat: int = 1
    """Steps of the environment that each decision is carried out for."""
    episode_length: int = 0
    """Steps of an episode that the cost limit is shared out over; 0: as measured."""
    cost_over: CostOver = "mean"
    """Whether the cost of a step is the mean or the largest of its imagined futures."""
    shared_noise: bool = True
    """Whether all candidates meet the same disturbances in imagination, so that they are compared like with like."""
    predict_end: bool = True
    """Whether imagined episodes can end, when the model says so; else they always go on for H steps."""
    members: int = 5
    """Models of the ensemble."""
    model_learning_rate: float = 1e-3
    """Adam's, for the ensemble."""
    model_decay: float = 1e-4
    """Weight decay of each model's last layer; towards the first it falls to a quarter."""
    fixed_variance_bounds: bool = False
    """Whether the bounds of the predicted log-variance stay where they begin, as in OmniSafe."""
    rarity: float = 10.0
    """The most by which a rare end or cost counts more than its absence in fitting; it does not shift what is
    predicted."""
    fitting: Fitting = "steady"
    """"steady": so many gradient steps per collection. "refit": whenever `refit_steps` have passed, over the whole
    replay until it no longer gets better."""
    model_steps: int = 64
    """Gradient steps of the ensemble per collection, with "steady"."""
    refit_steps: int = 1200
    """Steps between refits."""
    refit_patience: int = 5
    """Epochs of a refit without a gain of 1 % on the steps held out after which it stops."""
    hold_out: float = 0.05
    """Share of the steps that are not fitted to, but show how good the model is; at most a half."""
    minibatch: int = 256
    """Steps of one gradient step, for each model and for the critics."""
    hidden: tuple[int, ...] = (64, 64)
    """Sizes of the hidden layers of critics and actor."""
    critic_learning_rate: float = 1e-3
    """Adam's, for the critics."""
    critic_steps: int = 64
    """Gradient steps of the critics per collection."""
    critics_wait: bool = False
    """Whether critics (and an actor) begin to learn only when planning does, as in OmniSafe."""
    target_rate: float = 0.005
    """How far the target critics follow the critics in each gradient step."""
    steps_per_collection: int = 256
    """Steps between fittings, all environments together."""
    steps_per_update: int = 2048
    """Steps between reports, all environments together."""
    random_steps: int = 2048
    """Steps before planning begins, with actions at random."""
    replay_size: int = 1_000_000
    """Steps that are kept to learn from; the oldest make room."""
    drop_terminal: bool = False
    """Whether steps that end an episode are thrown away, as in OmniSafe: a cost that is paid at the end is then never
    seen."""
    precision: Precision = "float32"
    """Of the products of matrices in imagination; sums and states always have float32."""
    normalise_observations: bool = True
    """Whether observations are standardised by running statistics."""
    adapter: Adapter = "native"
    """Discrete actions as options ("native"), or as numbers that are rounded ("box_literal", "box_scaled")."""
    frame_stack: int = 1
    """How many of the last observations are seen side by side; the model predicts the newest. Not with an
    `action_repeat`: the model sees no frames between two decisions."""

    def __post_init__(self) -> None:
        require(self, self.conditions())

    def sized(self) -> Sizes:
        """What `size` says; each planner has its own."""
        raise NotImplementedError

    @property
    def sizes(self) -> Sizes:
        """What is really computed."""
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
        """What must hold of each field, in words."""
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
