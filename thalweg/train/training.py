"""A run between two moments: everything that changes while it goes on, and how it is put away and brought back."""

import time
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.vector import SyncVectorEnv, VectorEnv

from thalweg.algos.errors import LimitWarning
from thalweg.algos.interface import Feedback, Learner
from thalweg.cores import torch_threads
from thalweg.train.episodes import Episode, EpisodeBook
from thalweg.train.errors import ResumeWarning, TrainingError
from thalweg.train.rollout import RolloutBuffer
from thalweg.train.stream import Step, Stream


class Training:
    """An environment, a learner and what lies between them; it touches no file."""

    def __init__(self, env: VectorEnv, stream: Stream, learner: Learner, steps: int, seed: int, threads: int) -> None:
        self.env, self.stream, self.learner = env, stream, learner
        self.steps, self.seed, self.threads = steps, seed, threads
        self.book = EpisodeBook(stream.num_envs, world_names(env), reason_names(env))
        self.updates = 0
        self.seconds = 0.0
        """Time spent so far, over all interruptions."""
        self.stages = {"act": 0.0, "env": 0.0, "learn": 0.0}
        self.warned: dict[str, str] = {}
        """Warnings given so far, by their code."""
        self.obs = np.zeros((stream.num_envs, 0), dtype=np.float32)
        """[N, K * D] what the next action will see; nothing before `begin`."""
        self.fresh = np.ones(stream.num_envs, dtype=bool)
        self._began_update_at = 0
        self._buffer: RolloutBuffer | None = None

    def begin(self, state: dict[str, Any] | None = None) -> None:
        """Reset all environments, or go on from a state."""
        if state is None:
            self._begin_anew()
        else:
            self.load_state(state)

    @property
    def done(self) -> bool:
        return self.book.steps >= self.steps

    def step(self) -> list[Episode]:
        """One action in each environment; returns the episodes that it ended."""
        before = time.perf_counter()
        with torch_threads(self.threads):
            raw = self.learner.act(self.obs, self.fresh)
            actions = self.learner.policy.actions.to_env(raw)
        acted = time.perf_counter()
        step = self.stream.step(actions)
        after = time.perf_counter()
        if self._buffer is None:
            self._buffer = RolloutBuffer(self.learner.rollout_steps, self.obs, raw, self._costs(step))
        self._buffer.add(self.obs, self.fresh, raw, step, self._costs(step))
        self.obs, self.fresh = step.next_obs, step.fresh
        self.stages["act"] += acted - before
        self.stages["env"] += after - acted
        return self.book.add(step)

    @property
    def ready(self) -> bool:
        """Whether it is time to learn: from a whole rollout, or from the shorter one that ends the run."""
        return self._buffer is not None and (self._buffer.full or self.done)

    def update(self) -> dict[str, float]:
        """Learn from the rollout; returns the learner's metrics, if it has any to report yet."""
        assert self._buffer is not None
        feedback = self.feedback()
        before = time.perf_counter()
        with torch_threads(self.threads):
            metrics = self.learner.update(self._buffer.rollout(), feedback)
        self.stages["learn"] += time.perf_counter() - before
        self._buffer.clear()
        self._began_update_at = self.book.steps
        if metrics:
            self._warn(self.learner.warnings(feedback))
            self.book.fresh.clear()
            self.updates += 1
            if self.learner.resets and not self.done:
                self._begin_anew()
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
        getter = getattr(self.env, "get_state", None)
        environment = {} if getter is None else {"environment": dict(getter())}
        return environment | {
            "learner": self.learner.state(),
            "stream": self.stream.state(),
            "book": self.book.state(),
            "obs": self.obs.copy(),
            "fresh": self.fresh.copy(),
            "updates": self.updates,
            "seconds": self.seconds,
            "warned": dict(self.warned),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`. An environment that can't be brought back begins new episodes, with a
        `ResumeWarning`."""
        self.book.load_state(state["book"])
        self.updates, self.seconds = int(state["updates"]), float(state["seconds"])
        self.learner.load_state(state["learner"])
        self.warned = dict(state["warned"])
        self._began_update_at = self.book.steps
        if "environment" in state and hasattr(self.env, "set_state"):
            self.env.set_state(state["environment"])  # pyright: ignore[reportAttributeAccessIssue]
            self.stream.load_state(state["stream"])
            self.obs, self.fresh = np.array(state["obs"], dtype=np.float32), np.array(state["fresh"], dtype=bool)
            return
        warnings.warn(
            "the environment has no get_state and set_state: the run goes on with new episodes, and will not end with "
            "the same numbers as an unbroken one",
            ResumeWarning,
            stacklevel=4,
        )
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Reset all environments; their running episodes count for nothing."""
        self.book.abandon()
        self.obs = self.stream.reset(env_seeds(self.seed, self.book.steps, self.stream.num_envs))
        self.fresh = np.ones(self.stream.num_envs, dtype=bool)

    def _costs(self, step: Step) -> np.ndarray:
        """[N, M] what the learner is told of the costs."""
        if not self.learner.separate_costs:
            return step.cost[:, None]
        if step.costs is None:
            raise TrainingError(
                "cost_limits are limits of tight and loose costs, but the environment does not tell them apart: "
                "info['costs'] [N, 2] is needed at every step"
            )
        return step.costs

    def _warn(self, found: dict[str, str]) -> None:
        for code, sentence in found.items():
            if code not in self.warned:
                self.warned[code] = sentence
                warnings.warn(sentence, LimitWarning, stacklevel=4)


def env_seeds(seed: int, steps: int, count: int) -> list[int]:
    """One seed for each environment of a run that begins new episodes after so many steps.

    A single number would be counted up from environment to environment (Gymnasium's convention), and runs of
    neighbouring seeds would share all their environments but one. 31 bits, since not every environment takes more.
    """
    return [int(word) >> 1 for word in np.random.SeedSequence([seed, steps]).generate_state(count)]


def world_names(env: VectorEnv) -> list[str]:
    """[N] the name and seed of the world of each environment; empty strings if it has none."""
    base: Any = env.unwrapped
    worlds, index = getattr(base, "worlds", None), getattr(base, "world_index", None)
    if worlds is None or index is None:
        return [""] * env.num_envs
    return [f"{worlds[i].name}-{worlds[i].seed}" for i in index]


def reason_names(env: VectorEnv) -> Mapping[int, str]:
    """The environment's own names for the codes of `info["done_reason"]`; none if it has none."""
    base: Any = env.unwrapped
    one = base.envs[0].unwrapped if isinstance(base, SyncVectorEnv) else base
    return getattr(one, "done_reasons", {})
