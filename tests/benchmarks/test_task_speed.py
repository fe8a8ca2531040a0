"""The benchmark of the speed of tasks: turns, the share that is lost, and its table."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.env.task.priced.flights import rivers
from thalweg.render import Camera
from thalweg.world import World

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    monkeypatch.delitem(sys.modules, "task_speed", raising=False)
    return importlib.import_module("task_speed")


def test_works_take_turns_of_which_the_first_does_not_count(script: ModuleType):
    now, took, order = [0.0], iter([60.0, 70.0, 1.0, 2.0, 3.0, 5.0]), []

    def work(name: str) -> None:
        order.append(name)
        now[0] += next(took)

    seconds = script.in_turns([lambda: work("a"), lambda: work("b")], 2, clock=lambda: now[0])
    assert seconds.tolist() == [[1.0, 2.0], [3.0, 5.0]] and order == ["a", "b"] * 3


def test_the_lost_share_is_the_median_over_turns(script: ModuleType):
    seconds = np.array([[1.0, 1.25], [1.0, 1.0], [4.0, 40.0]])
    assert script.lost_percent(seconds) == pytest.approx(20.0)


def test_objects_are_looked_up_and_drawn_in_one_of_two_works(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    drawn: list[int | None] = []
    poses_drawn: list[np.ndarray] = []

    class Drawing:
        def __init__(self, worlds) -> None:
            self.camera = Camera(16, 16)

        def render(self, poses, index, times, out, props=None) -> None:
            drawn.append(None if props is None else props.shape[1])
            poses_drawn.append(poses)

    monkeypatch.setattr(script, "Renderer", Drawing)
    for place in script.PLACES:
        drawn.clear()
        count, seconds = script.frames_of("Swimmers", [rivers()["ring"]], place, 2)
        assert drawn == [None, 24] * 3 * script.VIEWS and seconds.shape == (2, 2)
        assert 0 < count <= 24
    starts, flights = np.array(poses_drawn).reshape(2, script.VIEWS, 6, script.BATCH, 4)
    for views in (starts, flights):
        assert (views == views[:, :1]).all() and len(np.unique(views[:, 0, 0], axis=0)) == script.VIEWS


def test_actions_that_were_chosen_before_fly_the_pilots_flights(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(script, "STEPS", 12)
    actions = script.chosen_before("Nests", [rivers()["ring"]])
    env = script.made("Nests", [rivers()["ring"]])
    env.reset(seed=0)
    for chosen in actions:
        assert np.array_equal(chosen, env.pilot_actions())
        env.step(chosen)
    assert script.rules_speed("Nests", [rivers()["ring"]], actions, 2) > 0


def test_random_actions_are_those_that_the_environment_takes(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, medium_world: World
):
    monkeypatch.setattr(script, "STEPS", 3)
    for name in ("River", "River with inertia", "River of boats"):
        actions = script.at_random(name, [medium_world])
        assert actions.shape == (3, script.BATCH, 4)
        assert len(np.unique(actions[..., 0])) > 1
        env = script.made(name, [medium_world])
        env.reset(seed=0)
        assert all(env.action_space.contains(each) for each in actions)
        env.step(actions[0])


def test_weather_and_boats_are_what_their_names_say(script: ModuleType):
    *tasks, wind, inertia, boats, both = script.ENVIRONMENTS.values()
    assert [config.task for config in tasks] == list(script.TASKS)
    assert wind.wind is not None and inertia.dynamics == "inertial" and boats.vehicle == both.vehicle == "asv"
    assert both.wind is not None and both.current_m_per_s is not None and boats.wind is None


def test_the_table_has_the_medians_of_processes(script: ModuleType):
    found = [
        {"Nests": dict.fromkeys(script.FIGURES, value), "Portage": {"random_steps_per_s": 10 * value}}
        for value in (5.0, 1.0, 2.0)
    ]
    nests, portage = script.rows_of(found, "a core", "0.1")
    assert nests == ["Nests", "2", "2", *2 * ["2.0", "2.000", "2.000", "2.0"], "a core", "0.1"]
    assert portage == ["Portage", "20", *9 * [""], "a core", "0.1"]


def test_the_page_has_the_committed_table(script: ModuleType):
    section = script.page_table(script.read_csv(script.TABLE, script.COLUMNS))
    page = (ROOT / "docs" / "tasks.md").read_text(encoding="utf-8")
    assert script.replace_section(page, "speed", section) == page
