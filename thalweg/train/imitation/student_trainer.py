"""Base of the trainers of a student: the policy to begin with, counters, timed learning, and the state from which a run
resumes."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from thalweg.algos.imitation.student import Lesson, Student
from thalweg.core.compute.torch_threads import torch_threads
from thalweg.env.tasks import PAPER_TASK
from thalweg.train.fast_steps import fast_step_of
from thalweg.train.rollouts.episodes import EpisodeStatistics
from thalweg.train.run_in_folder import initialise_policy, load_policy, policy_file


def begin_student(student: Student, begin_with: Path) -> dict[str, Any]:
    """Let a student begin with the weights of a policy, and return what identifies its file.

    Raises `AlgorithmError` for a policy of another kind, and `TrainingError` for one with fast steps, of which students
    have none, and for one of a task that is not known here.
    """
    fast_step_of(load_policy(begin_with), PAPER_TASK)
    return initialise_policy(student.policy, policy_file(begin_with))


class StudentTrainer:
    """Base of trainers that touch no file; see `thalweg.train.loop.AnyTrainer` for their members."""

    def __init__(
        self,
        student: Student,
        statistics: EpisodeStatistics,
        stages: Sequence[str],
        *,
        steps: int,
        seed: int,
        threads: int,
    ) -> None:
        """Learn for `steps` steps; `threads` is for learning. `stages` names what takes time, `learn` among it."""
        self.student, self.statistics = student, statistics
        self.steps, self.seed, self.threads = steps, seed, threads
        self.stages = dict.fromkeys(stages, 0.0)
        """Seconds spent so far in each stage."""
        self.updates, self.seconds = 0, 0.0
        self.warned: dict[str, str] = {}

    @property
    def policy(self) -> Any:
        """The student's policy."""
        return self.student.policy

    @property
    def done(self) -> bool:
        """Whether all steps are taken."""
        return self.statistics.steps >= self.steps

    def learn(self, lesson: Lesson) -> dict[str, float]:
        """Learn from a lesson; returns the losses."""
        before = time.perf_counter()
        with torch_threads(self.threads):
            losses = self.student.learn(lesson)
        self.stages["learn"] += time.perf_counter() - before
        return losses

    def state(self) -> dict[str, Any]:
        """Return everything that the rest of the run depends on; valid between updates."""
        return {
            "student": self.student.state(),
            "statistics": self.statistics.state(),
            "updates": self.updates,
            "seconds": self.seconds,
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self.student.load_state(state["student"])
        self.statistics.load_state(state["statistics"])
        self.updates, self.seconds = int(state["updates"]), float(state["seconds"])
