"""Tests of the ideal eye of tasks, and of the objects that are drawn, against an independent computation."""

from typing import Any

import numpy as np
import pytest

from tests.env.handmade import BlankMaskRenderer, BlankRenderer, ring
from tests.env.task.priced import reference
from tests.env.task.priced.flights import PRICED, erratic, made, rivers
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.task.critic_info import PROGRESS, critic_features
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.env.task.priced.eye import TASK_FEATURES, features_of
from thalweg.env.task.priced.swimmers import mover_at
from thalweg.env.tasks import TASKS
from thalweg.render.records.props import PropKind


def flying(task: str, world: str, steps: int, **options: Any) -> RiverVectorEnv:
    """Environments in the middle of random flights."""
    env = made(task, rivers()[world], 6, observation="privileged", **options)
    rng = np.random.default_rng(1)
    env.reset(seed=4)
    for _ in range(steps):
        env.step(erratic(env, rng))
    return env


def seen(env: RiverVectorEnv, name: str) -> np.ndarray:
    return env.observe()[:, features_of(env.config.task).index(name)]


def body(pose: np.ndarray, x: float, y: float) -> tuple[float, float]:
    """Metres ahead and to the left of a pose [4]."""
    turned = (x - pose[0] + 1j * (y - pose[1])) * np.exp(-1j * pose[3])
    return turned.real, turned.imag


def test_the_papers_task_adds_nothing():
    assert features_of("River") == FEATURES and set(TASK_FEATURES) == set(TASKS)
    assert all(len(set(features_of(task))) == len(features_of(task)) for task in TASKS)


@pytest.mark.parametrize("task", PRICED)
def test_what_is_seen_of_the_river_is_as_in_the_papers_task_and_critics_are_told_the_same(task: str):
    env = flying(task, "ring", 7, critic_info=True)
    numbers = env.observe()
    assert numbers.shape == (6, len(features_of(task))) and env.observation_space.contains(numbers)
    plain = RiverVectorEnv(rivers()["ring"], 6, EnvConfig(observation="privileged"))
    plain.reset(seed=0)
    for name in ("pose", "segment", "travel"):
        getattr(plain.state, name)[:] = getattr(env.state, name)
    np.testing.assert_array_equal(numbers[:, : len(FEATURES)], plain.observe())
    assert seen(env, "time left") == pytest.approx(1 - env.state.steps / env.courses.max_steps[0])
    told = made(task, rivers()["ring"], critic_info=True)
    _, info = told.reset(seed=4)
    assert info["critic_obs"].shape == (6, len(PROGRESS) + len(features_of(task)))
    np.testing.assert_array_equal(info["critic_obs"][:, len(PROGRESS) :], told.ideal_eye())
    assert critic_features("none", task) == (*PROGRESS, *features_of(task))


@pytest.mark.parametrize("world", ["ring", "Hard"])
def test_the_nearest_swimmers_are_seen_nearest_first(world: str):
    env = flying("Swimmers", world, 9)
    river, courses = rivers()[world].river, env.courses
    for row, pose in enumerate(env.state.pose):
        scene, steps = int(env.state.scene[row]), int(env.state.steps[row])
        places = reference.swimmers(river, courses.haunt, int(courses.swimmers[0]), scene, steps)
        found = sorted((np.hypot(*(place - pose[:2])), *body(pose, *place)) for place in places)
        found = [each for each in found if each[0] < 40][:3]
        wanted = np.array(found + [(40.0, 0.0, 0.0)] * (3 - len(found)))
        numbers = [seen(env, f"swimmer {k} {what}")[row] for k in (1, 2, 3) for what in ("distance", "ahead", "left")]
        assert numbers == pytest.approx(wanted.ravel(), abs=1e-4)


@pytest.mark.parametrize("world", ["ring", "canal"])
def test_the_next_reserve_is_seen_in_the_direction_of_travel(world: str):
    env = flying("Nests", world, 5)
    river = rivers()[world].river
    inside = 0
    for row, pose in enumerate(env.state.pose):
        arc, travel = reference.nearest(river, *pose[:2])[0], int(env.state.travel[row])
        # All points ahead, one after another.
        ahead = np.arange(0.0, 60.0, 0.01)
        points = arc + travel * ahead
        points = points % river.length_m if river.closed else points
        within = np.any((env.courses.reserve[:, :1] <= points) & (points <= env.courses.reserve[:, 1:]), axis=0)
        begins = ahead[within.argmax()] if within.any() else 40.0
        ends = ahead[within.argmax() :][(~within[within.argmax() :]).argmax()] if within.any() else 40.0
        wanted = (float(within[0]), *((begins, min(ends, 40.0)) if begins < 40 else (40.0, 40.0)))
        found = [seen(env, f"{name}")[row] for name in ("in a reserve", "reserve begins", "reserve ends")]
        assert found == pytest.approx(wanted, abs=0.03)
        inside += int(within[0])
    assert 0 < inside < 6


def test_clearance_is_seen_up_to_its_range():
    env = flying("RacingLine", "Hard", 9)
    wanted = [min(reference.clearance(rivers()["Hard"], pose, 0.5), 4.0) for pose in env.state.pose]
    assert seen(env, "clearance") == pytest.approx(wanted, abs=1e-3) and min(wanted) < 3.0


@pytest.mark.parametrize("world", ["ring", "canal"])
def test_the_station_is_seen_and_stands_at_the_bank(world: str):
    env = flying("Portage", world, 12)
    river = rivers()[world].river
    points, arcs, widths, _ = reference.polyline(river)
    props = env.props()
    assert props is not None and props.shape == (6, 1, 6)
    for row, pose in enumerate(env.state.pose):
        station = env.state.station[row]
        place = [np.interp(station, arcs, values) for values in points.T]
        found = [seen(env, f"station {name}")[row] for name in ("ahead", "left")]
        assert found == pytest.approx(body(pose, *place), abs=1e-4)
        assert seen(env, "way to the station")[row] == pytest.approx(env.state.way[row], abs=1e-3)
        assert seen(env, "over land")[row] == reference.over_land(rivers()[world], *pose[:2])
        kind, x, y, z, yaw, _ = props[row, 0]
        aside = np.hypot(*(place - props[row, 0, 1:3]))
        assert kind == PropKind.STATION and aside == pytest.approx(np.interp(station, arcs, widths) / 2 - 0.3, abs=1e-3)
        assert (x + aside * np.cos(yaw), y + aside * np.sin(yaw)) == pytest.approx(tuple(place), abs=1e-3)
        assert z == pytest.approx(reference.nearest(river, x, y)[2], abs=0.05)


@pytest.mark.parametrize(("task", "kinds"), [("Swimmers", {0, 1, 2}), ("Nests", {3})])
def test_objects_about_a_vehicle_come_nearest_first(task: str, kinds: set[int]):
    env = flying(task, "Hard", 10)
    views = env.frames.views(env.state)
    props = env.observer.props(env.courses, views)
    assert props is not None and props.dtype == np.float32 and props.shape == (6, 24, 6)
    for row, pose in enumerate(env.state.pose):
        if task == "Swimmers":
            scene, steps = int(env.state.scene[row]), int(env.state.steps[row])
            movers = [mover_at(env.courses, 0, scene, steps, i) for i in range(int(env.courses.swimmers[0]))]
            rows = np.array(movers, np.float32)
        else:
            rows = env.courses.buoy.astype(np.float32)
        distance = np.hypot(*(rows[:, 1:3] - pose[:2]).T)
        order = np.argsort(distance, kind="stable")[:24]
        order = order[distance[order] <= 80.0]
        np.testing.assert_allclose(props[row, : len(order)], rows[order], atol=1e-4)
        assert not props[row, len(order) :].any()
    assert set(np.unique(props[..., 0]).astype(int)) <= kinds
    assert env.config.task_record.props <= 24


def test_objects_reach_the_renderer_where_there_are_any():
    for task, drawn in (("River", False), ("RacingLine", False), ("Swimmers", True), ("Portage", True)):
        renderer = BlankRenderer()
        config = EnvConfig(task=task)  # pyright: ignore[reportArgumentType]
        env = RiverVectorEnv(ring(), 3, config, renderer=renderer)
        env.reset(seed=0)
        assert (renderer.props is not None) == drawn
        if drawn:
            np.testing.assert_array_equal(renderer.props, env.props())
    # A renderer that knows no objects draws the paper's task.
    RiverVectorEnv(ring(), 2, EnvConfig(observation="mask"), renderer=BlankMaskRenderer()).reset(seed=0)
