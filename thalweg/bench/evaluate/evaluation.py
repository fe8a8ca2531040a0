"""How good is a policy? Every start of a fixed list is flown to its end exactly once.

The list belongs to the level, so that it is the same for every algorithm and seed. Nothing here is first-to-finish:
counting whichever episodes end first would favour short ones. Each episode has its own random generator, and
actions are drawn for one episode at a time, so that a row does not depend on what is flown beside it.
"""

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
import torch
from pydantic import Field, InstanceOf

from thalweg.algos.policy.policy import Player
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.baselines import Policy, Remembering, Sight
from thalweg.bench.evaluate.episodes import ENDS, REASONS, Episode
from thalweg.core.config import frozen_config
from thalweg.encoder import Encoder
from thalweg.env import EnvConfig, RiverVectorEnv, sample_starts
from thalweg.env.frame_renderer import relit_worlds
from thalweg.env.initial_poses import CLOCK_RANGE_S
from thalweg.render import Renderer
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.randomisation import Randomisation
from thalweg.train.build_notice import announce_build
from thalweg.world import World, level_named, load_or_build

EVALUATION, CLOCKS, LOOKS = zlib.crc32(b"evaluation"), zlib.crc32(b"clocks"), zlib.crc32(b"looks")
"""Streams of random numbers of the evaluation, so that nothing that is trained on comes from the same seed as a start:
neither the frames of the encoder nor the episodes of a policy."""
UNSEEN = 100_000
"""Seed of the first of a level's rivers that nothing is trained on."""


@frozen_config(ResultsError)
class EvaluationConfig:
    """How policies are evaluated; the same for all that are to be compared."""

    episodes: Annotated[int, Field(ge=1)] = 20
    """Starts per level."""
    starts_seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the level's list of starts."""
    deterministic: bool = False
    """Whether the most probable action is taken instead of a sampled one. Training samples."""
    env: InstanceOf[EnvConfig] = field(default_factory=lambda: EnvConfig(observation="none"))
    """Rules. Frames are rendered only for policies that see them."""


DEFAULT_EVALUATION = EvaluationConfig()


@dataclass(frozen=True)
class Label:
    """What the rows of an evaluation are called."""

    algorithm: str
    seed: int
    level: str


@dataclass(frozen=True)
class Course:
    """A world and the starts to fly on it; K starts."""

    world: World
    starts: np.ndarray
    """[K, 4] float64: x, y, z in metres and the heading in radians."""
    clocks_s: np.ndarray
    """[K] float64, where the water's clock stands at each start: its ripples are the same for every policy too."""
    places: np.ndarray
    """[K] int64, the place of each start in the level's list."""
    looks: np.ndarray | None = None
    """[K, P] float64, how each is seen (see `thalweg.render.records.appearance.PARAMETERS`); None for the usual day."""
    lights: tuple[World, ...] = ()
    """The world under each sun that starts are drawn from; none: under its own."""
    suns: np.ndarray | None = None
    """[K] int64, which of the lights each start has."""

    @classmethod
    def of_level(cls, level: str, config: EvaluationConfig) -> "Course":
        """The level's fixed river and its fixed list of starts."""
        chosen = level_named(level)
        announce_build(chosen, chosen.default_seed)
        return cls.on(load_or_build(chosen, chosen.default_seed), config)

    @classmethod
    def on(cls, world: World, config: EvaluationConfig) -> "Course":
        """A world and its fixed list of starts."""
        seed = EVALUATION + config.starts_seed
        starts = sample_starts(world, config.episodes, seed, config=config.env)
        clocks = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(CLOCKS,)))
        return cls(world, starts, clocks.uniform(0, CLOCK_RANGE_S, len(starts)), np.arange(len(starts)))

    @classmethod
    def unseen(cls, level: str, config: EvaluationConfig) -> list["Course"]:
        """As many rivers of the level as there are episodes, on which nothing is trained, and on each another place of
        its own list of starts: the first on the first, the second on the second, and so on."""
        chosen, courses = level_named(level), []
        for place in range(config.episodes):
            announce_build(chosen, UNSEEN + place)
            courses.append(cls.on(load_or_build(chosen, UNSEEN + place), config).only(place))
        return courses

    def varied(self, randomisation: Randomisation, config: EvaluationConfig) -> "Course":
        """The same starts, each seen in a way of its own, which is the same for every policy."""
        seeds = np.random.SeedSequence(EVALUATION + config.starts_seed, spawn_key=(LOOKS,))
        generator = np.random.default_rng(seeds)
        drawn = [randomisation.draw(generator) for _ in self.places]
        lights = relit_worlds([self.world], randomisation) if randomisation.suns else []
        looks, suns = np.array([look for look, _ in drawn]), np.array([sun for _, sun in drawn])
        return replace(self, looks=looks, lights=tuple(lights), suns=suns)

    def only(self, place: int) -> "Course":
        """The course with but one start of its list; flown alone it gives the same flight."""
        row = np.flatnonzero(self.places == place)
        looks, suns = (None if each is None else each[row] for each in (self.looks, self.suns))
        return replace(
            self,
            starts=self.starts[row],
            clocks_s=self.clocks_s[row],
            places=self.places[row],
            looks=looks,
            suns=suns,
        )


@dataclass(frozen=True)
class Step:
    """What is about to be flown, as `on_step` is told: K episodes are still in the air."""

    flying: np.ndarray
    """[K] int64, rows of the course."""
    poses: np.ndarray
    """[K, 4] float64, before the step."""
    time_s: np.ndarray
    """[K] float64."""
    returns: np.ndarray
    """[K] float64, so far."""
    waiting: int = 0
    """Episodes on other rivers that are still to be begun."""


Look = Callable[[Step], np.ndarray]
"""From what is about to be flown to observations [K, D], each row on its own."""


def episode_generator(label: Label, place: int) -> torch.Generator:
    """The generator of one episode's sampled actions, given by the seed, the level and the place in the list alone."""
    entropy = np.random.SeedSequence([label.seed, zlib.crc32(label.level.encode()), place])
    return torch.Generator().manual_seed(int(entropy.generate_state(1, np.uint64)[0] >> np.uint64(1)))


def through_encoder(place: World | Course, encoder: Encoder, renderer: Renderer | None = None) -> Look:
    """What a trained policy sees: the latents float32 [K, Z] of the frames at each step's poses and times.

    Of a course every start is seen in its own way, of a world all are on the usual day. Frames are drawn on the
    encoder's device, where a renderer that is given must be, and stay there.
    """
    course = place if isinstance(place, Course) else None
    worlds = [place] if isinstance(place, World) else place.lights or [place.world]
    drawn = renderer or Renderer(worlds, device=str(encoder.device))
    camera, device = drawn.camera, encoder.device

    def given(array: np.ndarray | None, rows: np.ndarray, usual: np.ndarray) -> np.ndarray:
        return np.repeat(usual, len(rows), axis=0) if array is None else array[rows]

    def look(step: Step) -> np.ndarray:
        rows = step.flying
        looks = given(course.looks if course else None, rows, look_values(None, 1))
        suns = given(course.suns if course else None, rows, np.zeros(1, np.int64))
        views = (suns, step.poses, step.time_s, look_rows(looks, camera))
        frames = torch.empty(len(rows), camera.height_px, camera.width_px, 4, dtype=torch.uint8, device=device)
        drawn.render_tensors(tuple(torch.from_numpy(np.ascontiguousarray(view)).to(device) for view in views), frames)
        return encoder.of_tensor(frames).cpu().numpy()

    return look


def evaluate(
    policy: Policy | Remembering,
    course: Course,
    label: Label,
    config: EvaluationConfig = DEFAULT_EVALUATION,
    *,
    look: Look | None = None,
    on_step: Callable[[Step], None] | None = None,
) -> list[Episode]:
    """One row per start of the course, in the order of the list.

    `look` gives the observations of policies that see frames (see `through_encoder`); `on_step` is called before every
    step. Raises `ValueError` for a policy that sees frames where there is no `look`.
    """
    sees: Sight = getattr(policy, "sees", "frames")
    if sees == "frames" and look is None:
        raise ValueError("this policy looks at frames: give `look`, such as through_encoder(world, load_encoder())")
    env = _begin(course, config)
    players = [_player(policy, episode_generator(label, int(place)), config) for place in course.places]
    tally = _Tally(len(course.starts))
    actions = np.ones((len(course.starts), 4), dtype=np.int64)
    while len(flying := np.flatnonzero(tally.reason < 0)):
        state = env.get_state()
        step = Step(flying, state["pose"][flying], state["time_s"][flying], tally.return_[flying])
        if on_step is not None:
            on_step(step)
        if sees == "frames" and look is not None:
            obs = look(step)
        else:
            obs = env.pilot_actions()[flying] if sees == "pilot" else np.zeros((len(flying), 0), np.float32)
        for row, index in enumerate(flying):
            actions[index] = players[index](obs[row : row + 1], tally.length[index : index + 1] == 0)[0]
        _, reward, _, _, info = env.step(actions)
        tally.add(flying, reward, info)
    env.close()
    return tally.rows(course, label)


def _player(policy: Policy | Remembering, generator: torch.Generator, config: EvaluationConfig) -> Player:
    """The policy in one episode, with a memory of its own."""
    if isinstance(policy, Remembering):
        return policy.player(1, deterministic=config.deterministic, generator=generator)
    return lambda obs, fresh: policy.act(obs, deterministic=config.deterministic, generator=generator)


def _begin(course: Course, config: EvaluationConfig) -> RiverVectorEnv:
    """The rules, with every start of the course set. An episode that ends is begun anew elsewhere and not looked at."""
    env = RiverVectorEnv([course.world], len(course.starts), config=config.env)
    env.reset(seed=config.starts_seed, options={"pose": course.starts})
    state = env.get_state()
    state["time_s"] = course.clocks_s.copy()
    env.set_state(state)
    return env


class _Tally:
    """Sums over each episode until its first end; what the slot flies after that is not counted."""

    def __init__(self, count: int) -> None:
        self.return_ = np.zeros(count)
        self.costs = np.zeros((count, 2))
        self.cost = np.zeros(count)
        self.length = np.zeros(count, dtype=np.int64)
        self.progress = np.zeros(count)
        self.reason = np.full(count, -1)
        self.ends = np.zeros((count, 3))

    def add(self, flying: np.ndarray, reward: np.ndarray, info: dict) -> None:
        self.return_[flying] += reward[flying]
        self.costs[flying] += info["costs"][flying]
        self.cost[flying] += info["cost"][flying]
        self.length[flying] += 1
        self.progress[flying] = info["progress"][flying]
        self.reason[flying] = info["done_reason"][flying]
        self.ends[flying] = info["pose"][flying, :3]

    def rows(self, course: Course, label: Label) -> list[Episode]:
        return [
            Episode(
                label.algorithm,
                label.seed,
                label.level,
                course.world.seed,
                int(course.places[index]),
                *(float(value) for value in course.starts[index]),
                return_=float(self.return_[index]),
                cost=float(self.cost[index]),
                tight=float(self.costs[index, 0]),
                loose=float(self.costs[index, 1]),
                length=int(self.length[index]),
                reason=REASONS[self.reason[index]],
                success=REASONS[self.reason[index]] == "Success",
                progress=float(self.progress[index]),
                **dict(zip(ENDS, map(float, self.ends[index]), strict=True)),
            )
            for index in range(len(course.starts))
        ]
