"""Evaluation of a policy: one episode from each start of a course.

Every episode is run to its end; counting the episodes that end first would favour short ones. Each episode has its own
random generator, and actions are sampled for one episode at a time, so a row does not depend on the other episodes of
the batch.
"""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from thalweg.algos.policy.player import Player
from thalweg.bench.evaluate.baselines import DRAWN, Constant, Policy, Random, RecurrentPolicy, Sight, sight_of
from thalweg.bench.evaluate.course import DEFAULT_EVALUATION, Course, EvaluationConfig
from thalweg.bench.evaluate.episodes import ALL_REASONS, END_COLUMNS, Episode, flown_of_ahead, share_ahead
from thalweg.bench.evaluate.functions import FunctionPolicy
from thalweg.bench.evaluate.shielded import FlightShield, check_moves, check_shield
from thalweg.core.compute.counter_random import scene_of, weather_of
from thalweg.core.compute.device import resolve_device
from thalweg.encoder import Encoder
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.config import DEFAULT_CONFIG
from thalweg.env.pilot.in_rivers import PILOTS
from thalweg.env.spaces import CHANNELS, from_unit_actions
from thalweg.render import Camera, Renderer
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.breeze import ruffle
from thalweg.render.records.quality import Quality
from thalweg.train.encoder_of_run import context_of
from thalweg.train.folder.run_record import PLUGIN
from thalweg.train.observations import camera_of, feels, observation_of
from thalweg.world import World


@dataclass(frozen=True)
class Label:
    """Algorithm, seed and level that the rows of an evaluation are labelled with."""

    algorithm: str
    seed: int
    level: str


@dataclass(frozen=True)
class Step:
    """State before a step of the evaluation; K episodes are running."""

    flying: np.ndarray
    """[K] int64, row of the course of each running episode."""
    poses: np.ndarray
    """[K, 4] float64, poses before the step."""
    time_s: np.ndarray
    """[K] float64."""
    returns: np.ndarray
    """[K] float64, returns so far."""
    props: np.ndarray | None = None
    """[K, P, 6] float32, the objects of the task in each view (`thalweg.render.records.props`); None without any."""
    wind: np.ndarray | None = None
    """[K, 2] float64, m/s towards east and north: the mean wind of each episode; None without any."""
    waiting: int = 0
    """Number of episodes on other rivers that have not started."""


Observe = Callable[[Step], np.ndarray]
"""A function from the state before a step to observations [K, D], or images uint8 [K, H, W, C]; rows do not depend on
one another."""


class FrameView:
    """An `Observe` that draws frames, and keeps those that it drew last."""

    def __init__(self, draw: Callable[[Step], torch.Tensor], see: Callable[[torch.Tensor], torch.Tensor]) -> None:
        """`draw` returns frames [K, H, W, C] whose last channel is the mask; `see` makes observations of them."""
        self._draw, self._see = draw, see
        self._frames = torch.zeros(0, 0, 0, 1, dtype=torch.uint8)

    def __call__(self, step: Step) -> np.ndarray:
        self._frames = self._draw(step)
        return self._see(self._frames).cpu().numpy()

    @property
    def masks(self) -> np.ndarray:
        """[K, H, W] uint8, the water masks of the frames that were drawn last."""
        return self._frames[..., -1].contiguous().cpu().numpy()


def episode_generator(label: Label, index: int) -> torch.Generator:
    """Return the generator that samples the actions of one episode; it depends on seed, level and start index alone."""
    entropy = np.random.SeedSequence([label.seed, zlib.crc32(label.level.encode()), index])
    return torch.Generator().manual_seed(int(entropy.generate_state(1, np.uint64)[0] >> np.uint64(1)))


def observation_function(
    policy: Policy | RecurrentPolicy,
    scene: World | Course,
    encoder: Encoder | None,
    device: str = "cpu",
    *,
    shielded: bool = False,
    quality: Quality = "full",
    camera: Camera | None = None,
) -> Observe | None:
    """Return the observation function of a policy in a scene; None for a policy for which nothing is drawn.

    Frames are those of `camera`, by default the one that the policy was trained with. Only policies of codes need the
    `encoder`; frames for them are rendered on its device, and images on the `device`.
    If a flight is `shielded`, masks are drawn for a policy that sees nothing. Raises the errors of `sight_of`, and
    `ValueError` for a policy of codes without an encoder.
    """
    sees, camera = sight_of(policy), camera or camera_of(policy)
    if sees == "images":
        renderer = _renderer_of(scene, camera, quality, device)
        return image_frames(scene, observation_of(policy), renderer, device)
    if sees != "frames":
        return image_frames(scene, "mask", _renderer_of(scene, camera, quality, device), device) if shielded else None
    if encoder is None:
        raise ValueError("this policy sees frames through an encoder: give one, such as load_encoder()")
    return encoded_frames(scene, encoder, _renderer_of(scene, camera, quality, str(encoder.device)))


def encoded_frames(scene: World | Course, encoder: Encoder, renderer: Renderer | None = None) -> Observe:
    """Return the observation function of a policy of codes: latents float32 [K, Z] of the frames at each step.

    On a course, each start has its own appearance; on a world, all have the default one. Frames are rendered on the
    encoder's device and stay there, and only masks if it sees no more; a renderer that is given must be on that device
    too.
    """
    draw = _frames_of(scene, 1 if encoder.inputs == "mask" else 4, encoder.device, renderer)
    return FrameView(draw, encoder.of_tensor)


def image_frames(
    scene: World | Course, observation: str, renderer: Renderer | None = None, device: str = "cpu"
) -> Observe:
    """Return the observation function of a policy of images: uint8 [K, H, W, C] with the channels of the observation.

    `observation` is `rgb+mask`, `rgb` or `mask`, for which only masks are drawn; raises `ValueError` for another one.
    Appearances are as in `encoded_frames`. A renderer that is given must be on the `device`.
    """
    if observation not in CHANNELS:
        raise ValueError(f"images are {', '.join(CHANNELS)}, not {observation!r}")
    channels = CHANNELS[observation]
    draw = _frames_of(scene, 1 if channels == 1 else 4, torch.device(resolve_device(device)), renderer)
    return FrameView(draw, lambda frames: frames[..., :channels])


def _worlds_of(scene: World | Course) -> Sequence[World]:
    """Return the worlds that are drawn of a scene, each under its suns."""
    return [scene] if isinstance(scene, World) else scene.lights or [scene.world]


def _renderer_of(scene: World | Course, camera: Camera, quality: Quality, device: str) -> Renderer:
    """Return a renderer of a scene."""
    return Renderer(_worlds_of(scene), camera, quality, device=resolve_device(device))


def _frames_of(
    scene: World | Course, channels: int, device: torch.device, renderer: Renderer | None
) -> Callable[[Step], torch.Tensor]:
    """Return a function that draws frames uint8 [K, H, W, channels] on a device; one channel is the mask alone."""
    course = scene if isinstance(scene, Course) else None
    renderer = renderer or Renderer(_worlds_of(scene), device=str(device))
    camera = renderer.camera

    def select(array: np.ndarray | None, rows: np.ndarray, default: np.ndarray) -> np.ndarray:
        return np.repeat(default, len(rows), axis=0) if array is None else array[rows]

    def draw(step: Step) -> torch.Tensor:
        rows = step.flying
        looks = select(course.looks if course else None, rows, look_values(None, 1))
        suns = select(course.suns if course else None, rows, np.zeros(1, np.int64))
        rows_of_looks = look_rows(looks, camera)
        if step.wind is not None:
            ruffle(rows_of_looks, *step.wind.T)
        arrays = (suns, step.poses, step.time_s, rows_of_looks)
        size = len(rows), camera.height_px, camera.width_px, channels
        frames = torch.empty(size, dtype=torch.uint8, device=device)
        views = tuple(torch.from_numpy(np.ascontiguousarray(array)).to(device) for array in arrays)
        props: dict[str, Any] = {} if step.props is None else {"props": torch.from_numpy(step.props).to(device)}
        renderer.render_tensors(views, frames, **props)
        return frames

    return draw


def evaluate(
    policy: Policy | RecurrentPolicy,
    course: Course,
    label: Label,
    config: EvaluationConfig = DEFAULT_EVALUATION,
    *,
    observe: Observe | None = None,
    on_step: Callable[[Step], None] | None = None,
    shield: FlightShield | None = None,
) -> list[Episode]:
    """Return one row per start of the course, in the order of the list.

    `observe` gives the observations of policies that see frames or images, see `observation_function`, and replaces the
    privileged observation of policies that see that; baselines ignore it. Proprioception follows for policies that
    were trained with it. `on_step` is called before every step. A `shield` replaces moves that it vetoes; it reads the
    masks of the frames that `observe` draws, and takes their camera to be that of `config.env`.

    Raises `ValueError` for a policy that sees frames or images if `observe` is None, the errors of `sight_of`, and
    those of `thalweg.bench.evaluate.shielded.check_shield`.
    """
    if shield is not None:
        check_shield(policy, observe)
        check_moves(config.env.action)
    sees = sight_of(policy)
    if sees in DRAWN and observe is None:
        such = "encoded_frames(world, load_encoder())" if sees == "frames" else "image_frames(world, 'rgb+mask')"
        raise ValueError(f"this policy sees {sees}: give `observe`, such as {such}")
    felt = feels(policy)
    env = start_env(course, config, sees, felt)
    if shield is not None:
        shield.begin(env, course.looks)
    generators = [episode_generator(label, int(index)) for index in course.indices]
    players = [
        player_of(policy, generator, deterministic=config.deterministic, env=config.env) for generator in generators
    ]
    totals = _EpisodeTotals(share_ahead(env), portage=config.env.task_record.portage)
    actions = from_unit_actions(config.env.action, np.zeros((len(course.starts), 4)))
    while len(flying := np.flatnonzero(totals.reason < 0)):
        state = env.get_state()
        props = env.props() if config.env.task_record.props else None
        seen = None if props is None else props[flying]
        wind = env.forces.horizontal[flying] if config.env.wind is not None else None
        step = Step(flying, state["pose"][flying], state["time_s"][flying], totals.return_[flying], seen, wind)
        if on_step is not None:
            on_step(step)
        if sees in (*DRAWN, "privileged") and observe is not None:
            obs = observe(step)
        else:
            obs = _observations(env, sees)[flying]
            if shield is not None and observe is not None:
                observe(step)
        if felt:
            obs = np.concatenate([obs, env.observe()["proprioception"][flying]], axis=1)
        for row, index in enumerate(flying):
            actions[index] = players[index](obs[row : row + 1], totals.length[index : index + 1] == 0)[0]
        if shield is not None:
            actions[flying] = shield.screen(flying, observe, actions[flying], players)
        _, reward, _, _, info = env.step(actions)
        totals.add(flying, reward, info)
    env.close()
    version, source = made_by(policy)
    rows = [replace(row, version=version, source=source) for row in totals.rows(course, label)]
    return rows if shield is None else shield.marked(rows)


def made_by(policy: Any) -> tuple[int, str]:
    """Return the version of the plug-in or function that a policy is from, and the hash of its source; 0 and an empty
    text for a policy of the package."""
    plugin = context_of(policy).get(PLUGIN, {})
    return plugin.get("version", 0), plugin.get("source", "")


def player_of(
    policy: Policy | RecurrentPolicy,
    generator: torch.Generator,
    *,
    deterministic: bool = False,
    env: EnvConfig = DEFAULT_CONFIG,
) -> Player:
    """Return the policy in one episode of an environment, with its own memory if it has one."""
    play = _own_player(policy, generator, deterministic=deterministic)
    if env.action == "continuous" and isinstance(policy, Random | Constant | FunctionPolicy):  # they choose options
        return lambda obs, fresh: from_unit_actions(env.action, 1 - play(obs, fresh), env.fast_ratio)
    return play


def _own_player(policy: Policy | RecurrentPolicy, generator: torch.Generator, *, deterministic: bool) -> Player:
    """Return the policy in one episode, with the actions that it returns."""
    if isinstance(policy, RecurrentPolicy):
        return policy.player(1, deterministic=deterministic, generator=generator)
    return lambda obs, fresh: policy.act(obs, deterministic=deterministic, generator=generator)


def _observations(env: RiverVectorEnv, sees: Sight) -> np.ndarray:
    """Return what a policy for which nothing is drawn sees in each slot [N, D]."""
    if sees == "privileged":
        return env.ideal_eye()
    return env.pilot_actions(sees) if sees in PILOTS["uav"] else np.zeros((env.num_envs, 0), np.float32)


def start_env(course: Course, config: EvaluationConfig, sees: Sight = "nothing", felt: bool = False) -> RiverVectorEnv:
    """Return an environment with one slot per start, which also observes proprioception if it is `felt`. A slot whose
    episode has ended resets itself and is ignored."""
    rules = config.env
    if felt or sees == "privileged":
        rules = rules.with_options(observation=("proprioception",) if felt else "privileged")
    env = RiverVectorEnv(course.rivers or [course.world], len(course.starts), config=rules)
    env.reset(seed=config.starts_seed, options={"pose": course.starts})
    state = env.get_state()
    state["time_s"] = course.clocks_s.copy()
    if "scene" in state:  # what moves belongs to the start, whichever others are flown beside it
        moves = env.courses.swimmers[env.world_index] > 0
        state["scene"] = np.where(moves, [scene_of(config.starts_seed, index) for index in course.indices], 0)
    env.set_state(state)
    for row, index in enumerate(course.indices):  # and so does the weather
        env.forces.begin_with(row, weather_of(config.starts_seed, int(index)))
    return env


class _EpisodeTotals:
    """Totals of each episode until its first end; later steps of its slot do not count."""

    def __init__(self, share_ahead: np.ndarray, *, portage: bool) -> None:
        """share_ahead [K]: see `share_ahead`; `portage`: whether that is of the way to a station."""
        count = len(share_ahead)
        self.share_ahead, self.portage = share_ahead, portage
        self.return_ = np.zeros(count)
        self.costs = np.zeros((count, 2))
        self.cost = np.zeros(count)
        self.length = np.zeros(count, dtype=np.int64)
        self.progress = np.zeros(count)
        self.reason = np.full(count, -1)
        self.ends = np.zeros((count, 3))

    def add(self, flying: np.ndarray, reward: np.ndarray, info: dict) -> None:
        self.return_[flying] += reward[flying]
        self.costs[flying] += info["costs"][flying, :2]
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
                (course.rivers[index] if course.rivers else course.world).seed,
                int(course.indices[index]),
                *(float(value) for value in course.starts[index]),
                return_=float(self.return_[index]),
                cost=float(self.cost[index]),
                tight=float(self.costs[index, 0]),
                loose=float(self.costs[index, 1]),
                length=int(self.length[index]),
                reason=ALL_REASONS[self.reason[index]],
                success=ALL_REASONS[self.reason[index]] == "Success",
                progress=float(self.progress[index]),
                ahead=flown_of_ahead(self.progress[index], self.share_ahead[index], portage=self.portage),
                **dict(zip(END_COLUMNS, map(float, self.ends[index]), strict=True)),
            )
            for index in range(len(course.starts))
        ]
