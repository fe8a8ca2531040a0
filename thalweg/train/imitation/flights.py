"""Flights of a student and its teacher: N environments that change river with each episode, stepped together.

A share of the episodes is flown by the teacher, and some moves are random, so that the student meets what its own
mistakes lead to, and the way back. Letters: N environments, L steps, M moves.
"""

import math
from typing import Any

import numpy as np
import torch

from thalweg.algos.common.state import array_of
from thalweg.algos.imitation.student import Lesson, Student
from thalweg.algos.policy.player import NetworkPlayer
from thalweg.algos.policy.vision import NO_OPTION, rows_of, write_rows
from thalweg.core.compute.torch_threads import torch_threads
from thalweg.env import RiverVectorEnv
from thalweg.env.frame_renderer import Views
from thalweg.env.moves import MOVE_OPTIONS
from thalweg.env.task.bird_eye import open_water
from thalweg.train.flip import flipped
from thalweg.train.imitation.mask_noise import corrupt
from thalweg.train.imitation.mirroring import mirror, mirror_numbers
from thalweg.train.imitation.sequences import Sequences
from thalweg.train.imitation.teachers import teacher_worths

PLAIN = ("river", "pose", "time_s", "segment", "travel", "last", "fresh", "worths", "privileged", "maps")
"""What is noted of each step, by the fields of `Sequences`."""


class Flights:
    """Episodes of N environments, of which each step is noted with the worths that the teacher gives to all moves."""

    def __init__(self, env: RiverVectorEnv, student: Student, seed: int) -> None:
        """`env` draws what the student sees, in rivers that change with each episode."""
        self.env, self.student = env, student
        self.rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
        self._player = NetworkPlayer(student.policy, env.num_envs, False, student.generator)
        self.images = np.zeros((0,), np.uint8)
        """[N, H, W, C] of the current state."""
        self.last = np.full((env.num_envs, MOVE_OPTIONS.shape[1]), NO_OPTION)
        """[N, A] int64, the options taken before."""
        self.fresh = np.ones(env.num_envs, bool)
        """[N], whether an episode begins."""
        self.taught = np.ones(env.num_envs, bool)
        """[N] whether the teacher flies the episode."""
        self._notes: dict[str, list[np.ndarray]] = {}
        self._rows: np.ndarray = np.zeros((0, 0, 0), np.uint8)
        """[L, N, pixels + A] memory for the rows of a sequence, which the next one overwrites."""
        self._noted = 0
        self._start: np.ndarray = np.zeros(0)
        self.begin()

    def begin(self) -> None:
        """Forget the noted steps: the next one is the first of new sequences."""
        self._notes = {name: [] for name in PLAIN}
        self._noted = 0
        hidden = self._player.hidden
        self._start = np.zeros((self.env.num_envs, 0), np.float32) if hidden is None else array_of(hidden)

    def reset(self, seeds: list[int]) -> None:
        """Start new episodes in all environments."""
        self.images, _ = self.env.reset(seed=seeds)

    def restart(self, mask: np.ndarray) -> None:
        """Start new episodes in the environments of a mask [N], in place of the running ones."""
        self.images, _ = self.env.reset(options={"reset_mask": mask})
        self.fresh = self.fresh | mask

    @property
    def noted(self) -> int:
        """Steps of each environment since `begin`."""
        return self._noted

    def act(self, teacher_share: float, noise: float) -> np.ndarray:
        """Note the current state, and return the actions [N, 4] int64 to take in it."""
        count = self.env.num_envs
        self.taught[self.fresh] = self.rng.random(int(self.fresh.sum())) < teacher_share
        self.last[self.fresh] = NO_OPTION
        worths = teacher_worths(self.env, self.student.config.teacher)
        rows = self._next_rows()
        write_rows(rows, self.images, self.last)
        self._note(worths)
        with torch_threads(1):
            seen = torch.from_numpy(rows), torch.from_numpy(self.fresh.copy())
            raw = self._player.raw(*(tensor.to(self.student.device) for tensor in seen)).cpu()
        options = np.where(self.taught[:, None], MOVE_OPTIONS[worths.argmax(axis=1)], raw.numpy())
        random_moves = self.rng.random(count) < noise
        options = np.where(
            random_moves[:, None], MOVE_OPTIONS[self.rng.integers(len(MOVE_OPTIONS), size=count)], options
        )
        self.last = options.astype(np.int64)
        return options

    def arrive(self, images: np.ndarray, fresh: np.ndarray) -> None:
        """Set what the next step starts from: images [N, H, W, C], of which `fresh` [N] begin an episode."""
        self.images, self.fresh = images, fresh

    def sequences(self) -> Sequences:
        """Return the noted steps."""
        notes = {name: np.stack(values) for name, values in self._notes.items()}
        return Sequences(start=self._start, **notes)

    def lesson(self, sequences: Sequences) -> Lesson:
        """Return the noted steps as the student learns from them, until the next step; `sequences` are those of
        `sequences()`."""
        return lesson_of(sequences, self._rows[: self._noted])

    def in_mirror(self, sequences: Sequences) -> Lesson:
        """Return the noted steps as in a mirror; `sequences` are those of `sequences()`, and stay as they are."""
        other, shape = Sequences(*(array.copy() for array in sequences)), self.images.shape
        rows = self._rows[: self._noted]
        images = np.ascontiguousarray(rows[..., : math.prod(shape[1:])]).reshape(self._noted, *shape)
        mirror_numbers(other, np.arange(shape[0]))
        return lesson_of(other, rows_of(flipped(images), other.last))

    def drawn_again(self, sequences: Sequences) -> Lesson:
        """Return stored sequences as the student learns from them: drawn under new looks, some mirrored in place, some
        with corrupted masks."""
        config = self.student.config
        images = redraw(self.env, sequences, self.rng)
        mirror(images, sequences, config.mirrored, self.rng)
        corrupt(images, str(self.env.config.observation), config.corrupted_masks, self.rng)
        return lesson_of(sequences, rows_of(images, sequences.last))

    def state(self) -> dict[str, Any]:
        """Return what the next step depends on; valid while no step is noted."""
        return {
            "environment": dict(self.env.get_state()),
            "images": self.images.copy(),
            "last": self.last.copy(),
            "fresh": self.fresh.copy(),
            "taught": self.taught.copy(),
            "player": self._player.state(),
            "rng": self.rng.bit_generator.state,
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self.env.set_state(state["environment"])
        self.images, self.last = np.array(state["images"]), np.array(state["last"])
        self.fresh, self.taught = np.array(state["fresh"], bool), np.array(state["taught"], bool)
        self._player.load_state(state["player"])
        self.rng.bit_generator.state = state["rng"]
        self.begin()

    def _next_rows(self) -> np.ndarray:
        """Return memory [N, pixels + A] for the rows of the next step."""
        if not self._rows.size:
            shape = self.images.shape
            width = math.prod(shape[1:]) + self.last.shape[1]
            self._rows = np.empty((self.student.config.sequence, shape[0], width), np.uint8)
        self._noted += 1
        return self._rows[self._noted - 1]

    def _note(self, worths: np.ndarray) -> None:
        """Note the current state and what the teacher knows of it."""
        env, state = self.env, self.env.state
        maps = open_water(env.courses, state).reshape(env.num_envs, -1)
        values = {
            "river": env.rivers.state()["river"],
            "pose": state.pose.copy(),
            "time_s": state.time_s.copy(),
            "segment": state.segment.copy(),
            "travel": state.travel.copy(),
            "last": self.last.astype(np.int8),
            "fresh": self.fresh.copy(),
            "worths": worths.astype(np.float32),
            "privileged": env.ideal_eye(),
            "maps": np.packbits(maps, axis=1),
        }
        for name, value in values.items():
            self._notes[name].append(value)


def lesson_of(sequences: Sequences, rows: np.ndarray) -> Lesson:
    """Return sequences [L, C] with their rows of images and last actions [L, C, pixels + A]."""
    return Lesson(
        torch.from_numpy(rows),
        torch.from_numpy(sequences.fresh),
        torch.from_numpy(np.ascontiguousarray(sequences.start)),
        torch.from_numpy(sequences.worths),
        torch.from_numpy(sequences.privileged),
        torch.from_numpy(np.unpackbits(sequences.maps, axis=-1)),
    )


def redraw(env: RiverVectorEnv, sequences: Sequences, rng: np.random.Generator) -> np.ndarray:
    """Return the images [L, C, H, W, C'] of stored sequences, with a new look for each episode among them."""
    length, count = sequences.river.shape
    episode = sequences.fresh.cumsum(axis=0)
    looks, suns = drawn_looks(env, count * (int(episode.max()) + 1), rng)
    index = np.arange(count)[None, :] * (int(episode.max()) + 1) + episode
    views = Views(
        sequences.pose.reshape(-1, 4),
        sequences.river.ravel(),
        sequences.time_s.ravel(),
        looks[index.ravel()],
        suns[index.ravel()],
        sequences.segment.ravel(),
        sequences.travel.ravel(),
        *(np.zeros(length * count, kind) for kind in (np.int64, np.int64, np.float64)),  # nothing of a task is drawn
    )
    images = env.draw(sequences.river.ravel(), views)
    return images.reshape(length, count, *images.shape[1:])


def drawn_looks(env: RiverVectorEnv, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return looks [K, P] and suns [K] from the ranges of an environment."""
    if env.frames.randomisation is None:
        return np.repeat(env.frames.look[:1], count, axis=0), np.zeros(count, np.int64)
    drawn = [env.frames.randomisation.draw(rng) for _ in range(count)]
    return np.array([look for look, _ in drawn]), np.array([sun for _, sun in drawn], np.int64)
