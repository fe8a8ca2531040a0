"""A run between two moments: everything that changes while it goes on, and how it is put away and brought back."""

import time
import warnings
from typing import Any

from thalweg.algos.common.errors import LimitWarning
from thalweg.algos.interface import Feedback, Learner
from thalweg.core.torch_threads import torch_threads
from thalweg.train.rollouts.collector import Collector
from thalweg.train.rollouts.episodes import Episode


class Training:
    """A learner and who takes its steps; it touches no file."""

    def __init__(self, collector: Collector, learner: Learner, steps: int, seed: int, threads: int) -> None:
        self.collector, self.learner, self.book = collector, learner, collector.book
        self.steps, self.seed, self.threads = steps, seed, threads
        self.updates = 0
        self.seconds = 0.0
        """Time spent so far, over all interruptions."""
        self.learning_s = 0.0
        self.warned: dict[str, str] = {}
        """Warnings given so far, by their code."""
        self._began_update_at = 0

    def begin(self, state: dict[str, Any] | None = None) -> None:
        """Reset all environments, or go on from a state."""
        if state is None:
            self.collector.begin(self.seed)
        else:
            self.load_state(state)

    @property
    def done(self) -> bool:
        return self.book.steps >= self.steps

    @property
    def stages(self) -> dict[str, float]:
        """Seconds spent so far on each."""
        return {**self.collector.stages, "learn": self.learning_s}

    def step(self) -> list[Episode]:
        """One action in each environment; returns the episodes that have been found to be over."""
        return self.collector.step(self.learner)

    @property
    def ready(self) -> bool:
        """Whether it is time to learn: from a whole rollout, or from the shorter one that ends the run."""
        waiting = self.collector.waiting
        return waiting == self.learner.rollout_steps or (waiting > 0 and self.done)

    def update(self) -> dict[str, float]:
        """Learn from the rollout; returns the learner's metrics, if it has any to report yet."""
        feedback = self.feedback()
        before = time.perf_counter()
        with torch_threads(self.threads):
            metrics = self.learner.update(self.collector.rollout(), feedback)
        self.learning_s += time.perf_counter() - before
        self.collector.clear()
        self._began_update_at = self.book.steps
        if metrics:
            self._warn(self.learner.warnings(feedback))
            self.book.fresh.clear()
            self.updates += 1
            if self.learner.resets and not self.done:
                self.collector.begin(self.seed)
        return metrics

    def feedback(self) -> Feedback:
        """What the episodes say to the learner."""
        fresh, recent, largest = self.book.costs(self.learner.separate_costs)
        return Feedback(
            progress=min(self._began_update_at / self.steps, 1.0),
            steps_left=max(self.steps - self.book.steps, 0),
            fresh_costs=fresh,
            recent_costs=recent,
            episodes=self.book.count,
            largest_costs=largest,
            mean_length=self.book.mean_length,
        )

    def state(self) -> dict[str, Any]:
        """Everything that the rest of the run depends on; between updates, when no step is waiting to be learnt
        from."""
        return self.collector.state() | {
            "learner": self.learner.state(),
            "book": self.book.state(),
            "updates": self.updates,
            "seconds": self.seconds,
            "warned": dict(self.warned),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`; see `Collector.load_state`."""
        self.book.load_state(state["book"])
        self.updates, self.seconds = int(state["updates"]), float(state["seconds"])
        self.learner.load_state(state["learner"])
        self.warned = dict(state["warned"])
        self._began_update_at = self.book.steps
        self.collector.load_state(state, self.seed)

    def _warn(self, found: dict[str, str]) -> None:
        for code, sentence in found.items():
            if code not in self.warned:
                self.warned[code] = sentence
                warnings.warn(sentence, LimitWarning, stacklevel=4)
