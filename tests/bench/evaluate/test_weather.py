"""Tests of evaluated flights under wind, current and inertia: the weather belongs to the start."""

from dataclasses import replace

import numpy as np
import pytest

from tests.env.handmade import ring
from tests.env.winds import wind_of
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, Step, evaluate, image_frames, start_env
from thalweg.bench.evaluate.shielded import check_moves
from thalweg.env import EnvConfig
from thalweg.env.forces.options import ForceOptions
from thalweg.render import Renderer
from thalweg.world import World

WIND = ForceOptions(wind=wind_of(speed_m_per_s=(1.0, 4.0)), current_m_per_s=(0.1, 0.9))
STILL = EnvConfig(observation="none")
WINDY = EvaluationConfig(4, env=WIND.applied(STILL))
COURSE = Course.on(ring(), WINDY)


def weather(course: Course, config: EvaluationConfig = WINDY) -> np.ndarray:
    """Mean wind, direction, gusts, first filter states and current of each start."""
    state = start_env(course, config).get_state()
    return np.column_stack([state[f"force_{name}"] for name in ("key", "mean_wind", "gust", "current")])


def test_each_start_has_its_own_weather_whichever_others_are_flown():
    together = weather(COURSE)
    assert len({tuple(row) for row in together[:, :3]}) == 4
    for rows in ([2], [3, 1], [0, 1, 2]):
        np.testing.assert_array_equal(weather(COURSE.those(rows)), together[sorted(rows)])
    joined = Course.joined([COURSE.only(3), COURSE.only(0)])
    np.testing.assert_array_equal(weather(joined), together[[3, 0]])


def test_another_list_of_starts_has_other_weather():
    other = replace(WINDY, starts_seed=1)
    assert not np.isin(weather(COURSE, other)[:, 0], weather(COURSE)[:, 0]).any()


def test_means_are_drawn_from_the_ranges():
    found = weather(COURSE)
    assert ((found[:, 1] >= 1.0) & (found[:, 1] <= 4.0)).all() and ((found[:, -1] >= 0.1) & (found[:, -1] <= 0.9)).all()


def test_a_flight_is_the_same_alone_and_among_others():
    label = Label("random", 0, "Easy")
    rows = evaluate(BASELINES["random"], COURSE, label, WINDY)
    (alone,) = evaluate(BASELINES["random"], COURSE.only(2), label, WINDY)
    assert alone == rows[2]
    still = evaluate(BASELINES["random"], COURSE, label, replace(WINDY, env=STILL))
    assert [row.end_x for row in rows] != [row.end_x for row in still]


def test_steps_tell_the_wind_that_frames_show():
    steps: list[Step] = []
    evaluate(BASELINES["hover"], COURSE.only(1), Label("hover", 0, "Easy"), WINDY, on_step=steps.append)
    speed, towards = weather(COURSE)[1, 1:3]
    assert steps[0].wind is not None
    np.testing.assert_allclose(steps[0].wind, [[speed * np.cos(towards), speed * np.sin(towards)]])
    np.testing.assert_array_equal(steps[-1].wind, steps[0].wind)
    evaluate(
        BASELINES["hover"],
        COURSE.only(1),
        Label("hover", 0, "Easy"),
        replace(WINDY, env=STILL),
        on_step=steps.append,
    )
    assert steps[-1].wind is None


@pytest.mark.slow
def test_frames_show_the_wind_of_their_step(easy_world: World):
    course = Course.on(easy_world, replace(WINDY, episodes=2))
    winds = np.array([[6.0, 0.0], [0.0, -4.0]])
    at = np.arange(2), course.starts, course.clocks_s, np.zeros(2)
    seen = image_frames(easy_world, "rgb+mask")(Step(*at, wind=winds))
    drawn = Renderer([easy_world]).render(course.starts, time_s=course.clocks_s, wind=winds)
    np.testing.assert_array_equal(seen, drawn)
    assert (seen != image_frames(easy_world, "rgb+mask")(Step(*at))).any()


@pytest.mark.parametrize("name", ["hover", "forward", "random", "pilot", "steady"])
def test_baselines_command_velocities_where_dynamics_are_inertial(name: str):
    config = EvaluationConfig(2, env=ForceOptions(dynamics="inertial").applied(STILL))
    steps: list[Step] = []
    rows = evaluate(BASELINES[name], COURSE.those([0, 1]), Label(name, 0, "Easy"), config, on_step=steps.append)
    moved = np.linalg.norm(steps[3].poses[0] - steps[0].poses[0])
    assert moved == 0.0 if name == "hover" else moved > 0.1
    assert len(rows) == 2


def test_a_step_forward_is_a_command_of_full_speed():
    """After one step from rest the way is that of `Inertia`: v (t - T + T exp(-t / T)), limited in acceleration."""
    config = EvaluationConfig(1, env=ForceOptions(dynamics="inertial").applied(STILL))
    steps: list[Step] = []
    evaluate(BASELINES["forward"], COURSE.only(0), Label("forward", 0, "Easy"), config, on_step=steps.append)
    # An error of 4 m/s shrinks by 5 m/s² as long as it exceeds 5 m/s² times 0.4 s: for the whole step of 0.25 s.
    way = np.linalg.norm(steps[1].poses[0, :2] - steps[0].poses[0, :2])
    assert way == pytest.approx(0.5 * 5.0 * 0.25**2)


def test_the_shield_refuses_continuous_actions():
    check_moves("multidiscrete")
    with pytest.raises(ResultsError, match="multidiscrete actions, but these are continuous"):
        check_moves("continuous")
