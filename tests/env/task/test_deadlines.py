"""Deadlines that nobody can meet, on rings whose least way is known."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.env.handmade import canal, ring, world_of
from thalweg.env import ConfigError, EnvConfig
from thalweg.env.physics.wind import Wind
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.task.deadlines import check_deadline, deadline, least_way_m
from thalweg.env.tasks import TASKS, Task
from thalweg.world import World


def hurried(monkeypatch: pytest.MonkeyPatch, task: str, steps_per_m: float, **options: Any) -> EnvConfig:
    """A config of a task with another deadline."""
    monkeypatch.setitem(TASKS, "Hurried", replace(TASKS[task], deadline_steps_per_m=steps_per_m))
    return EnvConfig(task="Hurried", observation="none", **options)


def test_the_least_way_round_a_ring_is_along_its_inner_bank():
    # A ring of radius 20 m and width 6 m has an inner bank of radius 17 m; a polygon of 96 corners is a little shorter.
    assert least_way_m(TASKS["RacingLine"], ring().river) == pytest.approx(2 * np.pi * 17, rel=1e-3)


def test_the_least_way_to_a_station_is_the_straight_line_from_bank_to_bank():
    assert least_way_m(TASKS["Portage"], ring().river) == pytest.approx(34.0)


def test_the_least_way_cuts_bends_to_both_sides():
    """Bends to the right save as much as those to the left."""
    points = ring(count=400).river.position_m
    angle = np.arctan2(points[:, 1], points[:, 0])
    waves = world_of(points * (1 + 0.1 * np.cos(6 * angle))[:, None], width_m=2.0)
    direction = np.unwrap(np.arctan2(waves.river.tangent[:, 1], waves.river.tangent[:, 0]))
    turns = np.abs(np.diff(np.append(direction, direction[0] + 2 * np.pi))).sum()
    assert turns > 3 * np.pi
    assert least_way_m(TASKS["Nests"], waves.river) == pytest.approx(waves.river.length_m - turns * 1.0)


@pytest.mark.parametrize(
    ("task", "refused", "allowed", "told"),
    [
        # 106.8 m along the inner bank are 52 steps of 2.06 m, of which nine tenths are 0.371 per metre of 125.6 m.
        ("RacingLine", 0.36, 0.38, "46 steps: even along the inner bank the course takes 52 steps of 2.06 m; .* 0.42,"),
        # 34 m straight are 31 steps of 1.12 m, of which nine tenths are 0.436 per metre of 62.8 m.
        ("Portage", 0.42, 0.45, "27 steps: even in a straight line the station is 31 steps of 1.12 m; .* 0.49,"),
    ],
)
def test_a_deadline_that_nobody_can_meet_is_refused(
    task: str, refused: float, allowed: float, told: str, monkeypatch: pytest.MonkeyPatch
):
    message = f"nobody can meet the deadline of Hurried on handmade-0, {told} got {refused}"
    with pytest.raises(ConfigError, match=message):
        pack_courses([ring(), ring(width_m=2.0)], hurried(monkeypatch, task, refused))
    check_deadline(ring(), hurried(monkeypatch, task, allowed))


def test_a_longer_step_meets_a_shorter_deadline(monkeypatch: pytest.MonkeyPatch):
    config = hurried(monkeypatch, "Nests", 0.5)
    with pytest.raises(ConfigError, match=r"96 steps of 1.12 m"):
        check_deadline(ring(), config)
    check_deadline(ring(), config.with_options(forward_step_m=2.0))


@pytest.mark.parametrize("options", [{"max_steps": 5}, {"wind": Wind(speed_m_per_s=(1.0, 1.0))}])
def test_nothing_is_said_of_another_maximum_or_of_a_vehicle_that_is_pushed(
    options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
):
    check_deadline(ring(), hurried(monkeypatch, "RacingLine", 0.1, **options))


def test_nothing_is_said_of_an_open_course(monkeypatch: pytest.MonkeyPatch):
    check_deadline(canal(), hurried(monkeypatch, "RacingLine", 0.1))


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("world", [ring(width_m=0.01), ring(), ring(radius_m=200.0, width_m=0.01)])
def test_no_task_of_the_package_is_refused_on_any_loop(task: str, world: World):
    check_deadline(world, EnvConfig(task=task, observation="none"))


def test_the_deadline_of_a_loop_with_a_station_is_for_half_of_it():
    river, task = ring().river, Task(deadline_steps_per_m=0.5)
    assert deadline(task, river) == 63 and deadline(replace(task, portage=True), river) == 32
