"""Trainer of an imitation: flights and lessons in turn, with the state from which a run resumes."""

import time
from typing import Any

import numpy as np

from thalweg.algos.imitation.student import Student
from thalweg.core.compute.torch_threads import torch_threads
from thalweg.env import RiverVectorEnv
from thalweg.train.imitation.flights import Flights
from thalweg.train.imitation.sequences import SequenceStore
from thalweg.train.imitation.student_trainer import StudentTrainer
from thalweg.train.rollouts.collector import done_reason_names, env_seeds, world_names
from thalweg.train.rollouts.episodes import Episode, EpisodeStatistics, StepRecord


class ImitationTrainer(StudentTrainer):
    """Flies and learns; it touches no file."""

    def __init__(self, env: RiverVectorEnv, student: Student, steps: int, seed: int, threads: int) -> None:
        """Fly `steps` steps, all environments together; `threads` is for learning."""
        statistics = EpisodeStatistics(env.num_envs, world_names(env), done_reason_names(env))
        super().__init__(
            student, statistics, ("act", "env", "learn", "redraw"), steps=steps, seed=seed, threads=threads
        )
        self.env = env
        self.flights = Flights(env, student, seed)
        # A run stores no more, and room is reserved at once.
        self.store = SequenceStore(min(student.config.capacity, steps + env.num_envs), student.config.sequence)
        self._restarted = np.arange(env.num_envs) < round(student.config.start_share * env.num_envs)
        """[N] whether flights begin anew every `start_steps`. Statistics leave them out: only failures would end."""

    def start(self, state: dict[str, Any] | None = None) -> None:
        """Reset all environments, or resume from a state."""
        if state is None:
            self.flights.reset(env_seeds(self.seed, 0, self.env.num_envs))
        else:
            self.load_state(state)

    @property
    def ready(self) -> bool:
        """Whether sequences are complete."""
        return self.flights.noted == self.student.config.sequence or (self.done and self.flights.noted > 0)

    def step(self) -> list[Episode]:
        """Take one action in each environment; returns the episodes that it ended, but for flights that begin anew."""
        config = self.student.config
        before = time.perf_counter()
        if self._restarted.any() and self.flights.noted % config.start_steps == 0:
            self.flights.restart(self._restarted)
        share = 1.0 - self.statistics.steps / config.teacher_steps if config.teacher_steps else 0.0
        actions = self.flights.act(max(share, 0.0), config.noise)
        acted = time.perf_counter()
        images, reward, terminated, truncated, info = self.env.step(actions)
        ended = terminated | truncated
        self.flights.arrive(images, ended)
        self.stages["act"] += acted - before
        self.stages["env"] += time.perf_counter() - acted
        record = StepRecord(
            reward=reward,
            cost=info["cost"],
            costs=info["costs"],
            terminated=terminated,
            truncated=truncated,
            valid=np.ones(self.env.num_envs, bool),
            finished=np.flatnonzero(ended & ~self._restarted),
            reasons=info["done_reason"],
            rivers=info["river"],
        )
        return self.statistics.add(record)

    def update(self) -> dict[str, float]:
        """Learn from the sequences that were flown, and from stored ones that are drawn anew; returns the losses."""
        config, student = self.student.config, self.student
        student.decay(self.statistics.steps / self.steps)
        sequences = self.flights.sequences()
        lesson = self.flights.lesson(sequences)
        with torch_threads(self.threads):
            student.update_scale(lesson.privileged.flatten(0, 1))
        losses = self.learn(lesson)
        found = dict(losses)
        if config.in_mirror:
            before = time.perf_counter()
            mirrored = self.flights.in_mirror(sequences)
            self.stages["learn"] += time.perf_counter() - before
            self.learn(mirrored)
            del mirrored  # stored ones are drawn into as much memory
        replayed = round(config.replay * self.env.num_envs)
        if self.store.count and replayed:
            chosen = self.flights.rng.integers(self.store.count, size=replayed)
            before = time.perf_counter()
            again = self.flights.drawn_again(self.store.take(chosen))
            self.stages["redraw"] += time.perf_counter() - before
            found |= {f"replayed_{name}": value for name, value in self.learn(again).items()}
        else:
            found |= {f"replayed_{name}": float("nan") for name in losses}
        if len(sequences.fresh) == config.sequence:
            self.store.add(sequences)
        self.flights.begin()
        self.statistics.since_update.clear()
        self.updates += 1
        return {**found, "learning_rate": student.optimiser.rate, "stored_steps": self.store.count * config.sequence}

    def state(self) -> dict[str, Any]:
        """Return everything that the rest of the run depends on; valid between updates."""
        return super().state() | {"flights": self.flights.state(), "store": self.store.state()}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        super().load_state(state)
        self.store.load_state(state["store"])
        self.flights.load_state(state["flights"])
