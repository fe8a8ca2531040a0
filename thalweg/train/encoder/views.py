"""Views of flights and of starts on many rivers, with what the ideal eye sees there: poses and times, but no frames.

Flights are those of both pilots, with random moves among theirs, so that they lead where policies get that learn: off
the middle of the channel, and across the course. Views may be of several tasks, each flown by its own rules; one
environment of the paper's task draws them all, as each view holds the objects about its vehicle. Letters: K views, R
rivers, P objects, T quantities.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.config import DEFAULT_CONFIG
from thalweg.env.frame_renderer import Views
from thalweg.env.moves import MOVE_OPTIONS
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.spaces import from_unit_actions
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.env.task.priced.station import END_GAP_M
from thalweg.env.task.progress import sample_rows
from thalweg.env.tasks import PAPER_TASK, TASKS
from thalweg.render.records.camera import Camera
from thalweg.render.records.props import PROP_COLUMNS
from thalweg.train.encoder.targets import targets_of, truths_in
from thalweg.train.imitation.flights import drawn_looks

PILOTS = ("scripted", "steady")
"""Pilots that fly in turn."""
STRAIGHT = "straight ahead"
"""In place of a pilot: every move is forward, which leads over land."""
STATION_AHEAD_M = 60.0
"""Greatest distance along the course of a station that is moved to a view. Those of episodes are half a course away, so
that hardly a view would show one."""
FLIGHT_STEPS, STRIDE = 32, 4
"""Steps of a flight, of which one in `STRIDE` is a view, the start included."""
MOST_NOISE = 0.5
"""Greatest share of random moves; that of each flight is drawn from 0 to this."""
AHEAD = from_unit_actions("multidiscrete", np.array([[0, 0, 1, 0]]))
TARGETS = FEATURES
"""Names of the T quantities that are true of a view of the paper's task: those of the ideal eye."""


class KnownViews(NamedTuple):
    """K views of R rivers, in turn, and what is true of them."""

    river: np.ndarray
    """[K] int64, index of the river in the list of rivers."""
    pose: np.ndarray
    """[K, 4] float64."""
    time_s: np.ndarray
    """[K] float64, clock of the water."""
    segment: np.ndarray
    """[K] int64, of the course, and the direction of travel along it; see `thalweg.env.task.rules.State`."""
    travel: np.ndarray
    steps: np.ndarray
    """[K] int64, and what the task keeps; see `State`."""
    scene: np.ndarray
    station: np.ndarray
    props: np.ndarray
    """[K, P, 6] float32, the objects about the vehicle, see `thalweg.render.records.props`; P = 0 without any."""
    task: np.ndarray
    """[K] int64, index of the task in the list of tasks."""
    truths: np.ndarray
    """[K, T] float32, see `thalweg.train.encoder.targets`; NaN in views of another task than that of a quantity."""

    def rows(self, chosen: np.ndarray | slice) -> "KnownViews":
        """Return some of the views."""
        return KnownViews(*(array[chosen] for array in self))


def flight_views(
    rivers: RiverList,
    each: int,
    seed: int,
    tasks: Sequence[str] = (PAPER_TASK,),
    camera: Camera = DEFAULT_CONFIG.camera,
) -> KnownViews:
    """Return `each` views of every river and task, [R each] of each task together, of disturbed flights from random
    starts; raises `EncoderInputError` for tasks that `targets_of` refuses.

    What is in view depends on the camera, where the vehicle is does not.
    """
    return _in_tasks(_flights, rivers, each, seed, tasks, camera)


def start_views(
    rivers: RiverList,
    each: int,
    seed: int,
    tasks: Sequence[str] = (PAPER_TASK,),
    camera: Camera = DEFAULT_CONFIG.camera,
) -> KnownViews:
    """Return `each` views of every river and task, [R each] of each task together, at random starts; raises as
    `flight_views`."""
    return _in_tasks(_starts, rivers, each, seed, tasks, camera)


def draw_views(env: RiverVectorEnv, views: KnownViews, generator: np.random.Generator) -> np.ndarray:
    """Return frames [K, H, W, C] of views, each under a look of its own; `env` draws the rivers of the same list.

    The objects of the views are drawn whatever the environment's task is.
    """
    looks, suns = drawn_looks(env, len(views.river), generator)
    course = views.segment, views.travel, views.steps, views.scene, views.station
    props = views.props if views.props.shape[1] else None
    drawn = Views(views.pose, views.river, views.time_s, looks, suns, *course, props=props)
    return env.draw(views.river, drawn)


def _flights(rivers: RiverList, each: int, seed: int, task: str, camera: Camera) -> KnownViews:
    """Return views of flights in a task, with the quantities of that task alone."""
    env, generator = _grounds(rivers, task, camera), _generator(seed, 2, task)
    pilots = (*PILOTS, STRAIGHT) if env.config.task_record.portage else PILOTS
    env.reset(seed=_seeds(seed, len(rivers), task))
    notes: list[KnownViews] = []
    for flight in range(-(-each * STRIDE // FLIGHT_STEPS)):
        if flight:
            env.reset()
        pilot = pilots[flight % len(pilots)]
        noise = generator.uniform(0.0, MOST_NOISE, env.num_envs)
        for step in range(FLIGHT_STEPS):
            if step % STRIDE == 0:
                notes.append(_noted(env, generator))
            actions = AHEAD if pilot == STRAIGHT else env.pilot_actions(pilot)
            other = generator.random(env.num_envs) < noise
            chosen = MOVE_OPTIONS[generator.integers(len(MOVE_OPTIONS), size=env.num_envs)]
            env.step(np.where(other[:, None], chosen, actions))
    env.close()
    return _joined(notes[:each])


def _starts(rivers: RiverList, each: int, seed: int, task: str, camera: Camera) -> KnownViews:
    """Return views at starts in a task, with the quantities of that task alone."""
    env, generator = _grounds(rivers, task, camera), _generator(seed, 9, task)
    notes = []
    for number in range(each):
        env.reset(seed=None if number else _seeds(seed, len(rivers), task))
        notes.append(_noted(env, generator))
    env.close()
    return _joined(notes)


def _in_tasks(
    views_of: Any, rivers: RiverList, each: int, seed: int, tasks: Sequence[str], camera: Camera
) -> KnownViews:
    """Return the views of all tasks, one task after the other, by `views_of` one."""
    names, most = targets_of(tasks), max(TASKS[task].props for task in tasks)
    parts = []
    for number, task in enumerate(tasks):
        own = views_of(rivers, each, seed, task, camera)
        count = len(own.river)
        truths, props = (
            np.full((count, len(names)), np.nan, np.float32),
            np.zeros((count, most, PROP_COLUMNS), np.float32),
        )
        truths[:, [names.index(name) for name in targets_of((task,))]] = own.truths
        props[:, : own.props.shape[1]] = own.props
        parts.append(own._replace(props=props, truths=truths, task=np.full(count, number)))
    return _joined(parts)


def _grounds(rivers: RiverList, task: str, camera: Camera) -> RiverVectorEnv:
    """Return an environment of a task in each river, which draws nothing."""
    worlds = [rivers.course(index) for index in range(len(rivers))]
    return RiverVectorEnv(worlds, len(worlds), EnvConfig(observation="none", task=task, camera=camera))


def _numbered(task: str) -> tuple[int, ...]:
    """Return what separates the random numbers of a task from those of others: nothing for the paper's."""
    return () if task == PAPER_TASK else (list(TASKS).index(task),)


def _generator(seed: int, stream: int, task: str) -> np.random.Generator:
    return np.random.default_rng([seed, stream, *_numbered(task)])


def _seeds(seed: int, count: int, task: str) -> list[int]:
    """Return a seed for each environment, apart from those of training and of evaluation."""
    spawned = np.random.SeedSequence(seed, spawn_key=(3, *_numbered(task)))
    return spawned.generate_state(count).astype(np.int64).tolist()


def _noted(env: RiverVectorEnv, generator: np.random.Generator) -> KnownViews:
    """Return the current state of R environments in R rivers."""
    state, count = env.state, env.num_envs
    own = state.station.copy()
    if env.config.task_record.portage:
        state.station[:] = _stations(env, generator)
    props = env.props()
    if props is None:
        props = np.zeros((count, 0, PROP_COLUMNS), np.float32)
    seen = state.pose, state.time_s, state.segment, state.travel, state.steps, state.scene, state.station
    copies: list[Any] = [array.copy() for array in seen]
    objects = {"props": props, "task": np.zeros(count, np.int64), "truths": truths_in(env, props)}
    note = KnownViews(np.arange(count), *copies, **objects)
    state.station[:] = own
    return note


def _stations(env: RiverVectorEnv, generator: np.random.Generator) -> np.ndarray:
    """Return the stations [N] of views, in metres along the course: in half of them near and ahead of the vehicle,
    elsewhere those of the episodes."""
    state, courses = env.state, env.courses
    first = [sample_rows(courses, *at)[0] for at in zip(state.world, state.segment, strict=True)]
    moved = generator.random(env.num_envs) < 0.5
    near = courses.arc[first] + state.travel * generator.uniform(0.0, STATION_AHEAD_M, env.num_envs)
    length, closed = courses.length[state.world], courses.closed[state.world] != 0
    near = np.where(closed, near % length, np.clip(near, END_GAP_M, length - END_GAP_M))
    return np.where(moved, near, state.station)


def _joined(notes: list[KnownViews]) -> KnownViews:
    return KnownViews(*(np.concatenate(arrays) for arrays in zip(*notes, strict=True)))
