"""Trainer: a learner and its collector, stepped and updated in turn, with the state from which a run resumes."""

import time
import warnings
from typing import Any

from thalweg.algos.common.errors import LimitWarning
from thalweg.algos.constraint.cost_limits import ENOUGH_EPISODES
from thalweg.algos.interface import Feedback, Learner
from thalweg.algos.policy.normaliser import CONSTANT_STD, Normaliser
from thalweg.core.compute.torch_threads import torch_threads
from thalweg.train.errors import UnitWarning
from thalweg.train.rollouts.collector import Collector
from thalweg.train.rollouts.episodes import Episode

NUMBERS_IGNORED = "numbers_ignored"
"""Code of the warning of numbers that vary too little to be seen."""
MOST_LISTED = 10
"""Numbers of an observation that a warning names at most."""


class Trainer:
    """Steps environments and updates a learner; it touches no file."""

    def __init__(self, collector: Collector, learner: Learner, steps: int, seed: int, threads: int) -> None:
        """Train for `steps` steps, all environments together; `threads` is for updates."""
        self.collector, self.learner, self.statistics = collector, learner, collector.statistics
        self.steps, self.seed, self.threads = steps, seed, threads
        self.updates = 0
        self.seconds = 0.0
        """Time spent so far, over all interruptions."""
        self.learning_s = 0.0
        self.warned: dict[str, str] = {}
        """Warnings given so far, by their code."""
        self._steps_at_update = 0

    def start(self, state: dict[str, Any] | None = None) -> None:
        """Reset all environments, or resume from a state."""
        if state is None:
            self.collector.reset(self.seed)
        else:
            self.load_state(state)

    @property
    def policy(self) -> Any:
        """The policy that is trained."""
        return self.learner.policy

    @property
    def done(self) -> bool:
        """Whether all steps are taken."""
        return self.statistics.steps >= self.steps

    @property
    def stages(self) -> dict[str, float]:
        """Seconds spent so far in each stage; those of an encoder around the environment are a stage of their own."""
        stages = self.collector.stages
        encode = getattr(self.collector.env, "stage_seconds", {}).get("encode", 0.0)
        return {**stages, "env": stages["env"] - encode, "learn": self.learning_s, "encode": encode}

    def step(self) -> list[Episode]:
        """Take one action in each environment; returns the episodes that are now known to have ended."""
        return self.collector.step(self.learner)

    @property
    def ready(self) -> bool:
        """Whether an update is due: after a complete rollout, or the shorter one that ends the run."""
        waiting = self.collector.waiting
        return waiting == self.learner.rollout_steps or (waiting > 0 and self.done)

    def update(self) -> dict[str, float]:
        """Learn from the rollout; returns the learner's metrics, or nothing if it has none to report yet."""
        feedback = self.feedback()
        before = time.perf_counter()
        with torch_threads(self.threads):
            metrics = self.learner.update(self.collector.rollout(), feedback)
        self.learning_s += time.perf_counter() - before
        self.collector.clear()
        self._steps_at_update = self.statistics.steps
        if metrics:
            self._warn(self.learner.warnings(feedback), LimitWarning)
            if feedback.episodes >= ENOUGH_EPISODES and NUMBERS_IGNORED not in self.warned:
                self._warn(overlooked_numbers(self.policy), UnitWarning)
            self.statistics.since_update.clear()
            self.updates += 1
            if self.learner.resets and not self.done:
                self.collector.reset(self.seed)
        return metrics

    def feedback(self) -> Feedback:
        """Return the statistics of episodes that the learner adapts to."""
        new, recent, largest = self.statistics.costs(self.learner.separate_costs)
        return Feedback(
            progress=min(self._steps_at_update / self.steps, 1.0),
            steps_left=max(self.steps - self.statistics.steps, 0),
            new_costs=new,
            recent_costs=recent,
            episodes=self.statistics.count,
            largest_costs=largest,
            lowest_costs=self.statistics.lowest_costs(self.learner.separate_costs),
            mean_length=self.statistics.mean_length,
            judged=self.statistics.judged,
        )

    def state(self) -> dict[str, Any]:
        """Return everything that the rest of the run depends on; valid between updates, when no step is waiting."""
        return self.collector.state() | {
            "learner": self.learner.state(),
            "book": self.statistics.state(),
            "updates": self.updates,
            "seconds": self.seconds,
            "warned": dict(self.warned),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore a state of `state`; see `Collector.load_state`."""
        self.statistics.load_state(state["book"])
        self.updates, self.seconds = int(state["updates"]), float(state["seconds"])
        self.learner.load_state(state["learner"])
        self.warned = dict(state["warned"])
        self._steps_at_update = self.statistics.steps
        self.collector.load_state(state, self.seed)

    def _warn(self, found: dict[str, str], kind: type[Warning]) -> None:
        """Give each warning, by its code, once in a run."""
        for code, sentence in found.items():
            if code not in self.warned:
                self.warned[code] = sentence
                warnings.warn(sentence, kind, stacklevel=5)


def overlooked_numbers(policy: Any) -> dict[str, str]:
    """Return a warning, by a short code, of numbers of the observation that vary, but that the policy ignores."""
    normaliser = getattr(policy, "normaliser", None)  # a plug-in's policy may have none, or another kind
    if not isinstance(normaliser, Normaliser) or not (found := normaliser.overlooked).any():
        return {}
    numbers = sorted({index % policy.obs_size for index in found.nonzero().squeeze(-1).tolist()})
    listed = ", ".join(map(str, numbers[:MOST_LISTED])) + (" and others" if len(numbers) > MOST_LISTED else "")
    sentence = (
        f"the policy ignores numbers of the observation, counted from 0: {listed}; they vary by a standard deviation of"
        f" at most {CONSTANT_STD:g}, and are taken for constant; give them in a smaller unit, such as multiples of"
        " their usual deviation, or set normalise_observations=false"
    )
    return {NUMBERS_IGNORED: sentence}
