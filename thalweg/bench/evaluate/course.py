"""Rivers that an evaluation flies on, and the fixed list of starts of each.

The list belongs to the river, so it is the same for every algorithm and seed.
"""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from pydantic import Field, InstanceOf

from thalweg.bench.csv_files import ResultsError
from thalweg.core.config import frozen_config
from thalweg.core.seeds import MAX_SEED, UNSEEN
from thalweg.env import EnvConfig, sample_starts
from thalweg.env.initial_poses import CLOCK_RANGE_S
from thalweg.env.rivers.bare_river import load_or_plan
from thalweg.env.rivers.sounded_river import load_or_sound
from thalweg.render.bake.sunlight import relit
from thalweg.render.records.randomisation import Randomisation
from thalweg.train.river import announce_build
from thalweg.world import Level, World, level_named, load_or_build

EVALUATION, CLOCKS, LOOKS = zlib.crc32(b"evaluation"), zlib.crc32(b"clocks"), zlib.crc32(b"looks")
"""Random streams of the evaluation. Nothing in training draws from them: neither the frames of the encoder nor the
episodes of a policy share a seed with a start."""


@frozen_config(ResultsError, numpy_scalars=True)
class EvaluationConfig:
    """Settings of an evaluation; they are the same for all policies that are compared."""

    episodes: Annotated[int, Field(ge=1)] = 20
    """Starts per river."""
    starts_seed: Annotated[int, Field(ge=0, le=MAX_SEED)] = 0
    """Seed of each river's list of starts."""
    deterministic: bool = False
    """Whether the most probable action is taken instead of a sampled one. Training samples."""
    env: InstanceOf[EnvConfig] = field(default_factory=lambda: EnvConfig(observation="none"))
    """Rules. What is observed depends on the policy alone; frames are rendered only for those that see them."""


DEFAULT_EVALUATION = EvaluationConfig()


@dataclass(frozen=True)
class Course:
    """A world and K starts on it."""

    world: World
    starts: np.ndarray
    """[K, 4] float64: x, y, z in metres and the heading in radians."""
    clocks_s: np.ndarray
    """[K] float64, the water's clock at each start, so that every policy sees the same ripples."""
    indices: np.ndarray
    """[K] int64, the index of each start in the level's list."""
    looks: np.ndarray | None = None
    """[K, P] float64, appearance of each episode (see `thalweg.render.records.appearance.PARAMETERS`); None for the
    default one."""
    lights: tuple[World, ...] = ()
    """The world under each sun; empty if only its own sun is used."""
    suns: np.ndarray | None = None
    """[K] int64, the index into `lights` of each start."""
    rivers: tuple[World, ...] = ()
    """World of each start, K of them, of a course that leads through several; `world` is then that of the first."""

    @classmethod
    def of_level(cls, level: str, config: EvaluationConfig, *, drawn: bool = True) -> "Course":
        """Return the course of a level: its fixed river, without land if nothing is `drawn`, and fixed list of starts.

        Land takes most of the time to build; flights are the same without it.
        """
        (course,) = cls.of_seeds(level, [level_named(level).default_seed], config, drawn=drawn)
        return course

    @classmethod
    def on(cls, world: World, config: EvaluationConfig) -> "Course":
        """Return the course of a world with its fixed list of starts."""
        seed = EVALUATION + config.starts_seed
        starts = sample_starts(world, config.episodes, seed, config=config.env)
        clocks = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(CLOCKS,)))
        return cls(world, starts, clocks.uniform(0, CLOCK_RANGE_S, len(starts)), np.arange(len(starts)))

    @classmethod
    def of_seeds(
        cls, level: str, seeds: Sequence[int], config: EvaluationConfig, *, drawn: bool = True
    ) -> Iterator["Course"]:
        """Yield the courses of a level's rivers with these seeds, each made when its turn comes. `drawn`: as for
        `of_level`."""
        chosen = level_named(level)
        for seed in seeds:
            yield cls.on(_river(chosen, seed, drawn, config.env.vehicle), config)

    @classmethod
    def unseen(cls, level: str, config: EvaluationConfig, *, drawn: bool = True) -> Iterator["Course"]:
        """Yield one course per episode, each on another unseen river of the level and with one start.

        The start on the i-th river is the i-th of that river's own list. Each is made when its turn comes, since the
        rivers of many episodes may not fit into the memory together. `drawn`: as for `of_level`.
        """
        courses = cls.of_seeds(level, range(UNSEEN, UNSEEN + config.episodes), config, drawn=drawn)
        for index, course in enumerate(courses):
            yield course.only(index)

    @classmethod
    def joined(cls, courses: Sequence["Course"]) -> "Course":
        """Return one course of courses with one start each, whose episodes are flown together.

        The episodes are the same as in each course alone. Raises `ValueError` for a course with several starts, and if
        some have appearances and others have none.
        """
        if any(len(course.starts) != 1 for course in courses) or not courses:
            raise ValueError(f"courses with one start each can be joined, not {[len(each.starts) for each in courses]}")
        if len({course.looks is None for course in courses}) > 1:
            raise ValueError("courses with appearances and without can't be joined")
        lights: list[World] = []
        suns = []
        for course in courses:
            suns.append(len(lights) + (0 if course.suns is None else int(course.suns[0])))
            lights += course.lights or (course.world,)
        starts, clocks, indices = (
            np.concatenate([getattr(course, name) for course in courses]) for name in ("starts", "clocks_s", "indices")
        )
        given = [course.looks for course in courses if course.looks is not None]
        return cls(
            courses[0].world,
            starts,
            clocks,
            indices,
            np.concatenate(given) if given else None,
            tuple(lights),
            np.array(suns, np.int64),
            tuple(course.world for course in courses),
        )

    def varied(self, randomisation: Randomisation, config: EvaluationConfig) -> "Course":
        """Return the course with a random appearance for each start. It depends on the start's place in the list alone,
        so that it is the same for every policy. Suns that light no start are not baked."""
        seeds = np.random.SeedSequence(EVALUATION + config.starts_seed, spawn_key=(LOOKS,))
        generator = np.random.default_rng(seeds)
        drawn = [randomisation.draw(generator) for _ in range(self.indices.max(initial=-1) + 1)]
        looks, suns = (np.array([drawn[index][part] for index in self.indices]) for part in (0, 1))
        used, suns = np.unique(suns, return_inverse=True)
        angles = randomisation.lights(self.world.seed)
        lights = [relit(self.world, *angles[sun]) for sun in used] if randomisation.suns else []
        return replace(self, looks=looks, lights=tuple(lights), suns=suns)

    def only(self, index: int) -> "Course":
        """Return the course with a single start of its list; the episode from it is the same as in the full course."""
        return self.those([index])

    def those(self, indices: Sequence[int]) -> "Course":
        """Return the course with these starts of its list, in the order of the list."""
        rows = np.flatnonzero(np.isin(self.indices, indices))
        looks, suns = (None if each is None else each[rows] for each in (self.looks, self.suns))
        return replace(
            self,
            starts=self.starts[rows],
            clocks_s=self.clocks_s[rows],
            indices=self.indices[rows],
            looks=looks,
            suns=suns,
            rivers=tuple(self.rivers[row] for row in rows) if self.rivers else (),
        )


def _river(level: Level, seed: int, drawn: bool, vehicle: str) -> World:
    """Return the river of a level and a seed, without land unless it is `drawn`, but with the bed that a boat needs; a
    build is announced."""
    if not drawn:
        return load_or_plan(level, seed) if vehicle == "uav" else load_or_sound(level, seed)
    announce_build(level, seed)
    return load_or_build(level, seed)
