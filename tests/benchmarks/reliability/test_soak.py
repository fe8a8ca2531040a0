"""Tests of the soak: rivers in turn, a short flight without a fault, and each fault that it must notice."""

from collections.abc import Callable
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from tests.env import handmade
from tests.world.lines import circle, course
from thalweg.env import EnvConfig
from thalweg.render.records.classes import SKY
from thalweg.world import World


@pytest.fixture
def soak(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("soak")


def test_all_tasks_of_both_vehicles_are_flown(soak: ModuleType):
    found = [(config.vehicle, config.task) for config in soak.cases()]
    tasks = ["River", "Swimmers", "Nests", "RacingLine", "Portage"]
    assert found == [*(("uav", task) for task in tasks), ("asv", "River")]


def test_the_rivers_of_pieces_are_all_different(soak: ModuleType):
    names = [name for piece in range(100) for name in soak.river_list(piece, 10).names]
    assert len(set(names)) == 1000
    assert names[:4] == ["Easy-30000", "Medium-30001", "Hard-30002", "Easy-30003"]


def test_the_boat_has_rivers_that_are_deep_enough(soak: ModuleType):
    assert soak.river_list(0, 3, "asv").names == ["Easy-30000", "Medium-Deep-30001", "Hard-Deep-30002"]
    boat = EnvConfig(vehicle="asv", observation="none")
    assert len(soak.worlds_for(0, 3, boat)) == 3


def test_rivers_that_the_boat_does_not_fit_are_left_out(soak: ModuleType, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(soak.LEVELS, "asv", ("Easy", "Medium", "Hard"))
    found = soak.worlds_for(0, 3, EnvConfig(vehicle="asv", observation="none"))
    assert 30002 not in [world.seed for world in found] and len(found) < 3


def test_a_vehicle_that_fits_no_river_of_a_piece_is_not_counted_as_flown(
    soak: ModuleType, monkeypatch: pytest.MonkeyPatch
):
    flown, ring = [], handmade.ring()
    monkeypatch.setattr(soak, "worlds_for", lambda piece, rivers, config: [ring] * (config.vehicle == "uav"))

    def fly(worlds: list[World], config: EnvConfig, *_: int) -> SimpleNamespace:
        flown.append((config.vehicle, len(worlds)))
        return SimpleNamespace(faults=[])

    monkeypatch.setattr(soak, "fly", fly)
    assert list(soak.soak_steps(0, 3, 100)) == ["asv River: not flown, since it fits none of the 3 rivers"]
    assert flown == [("uav", 1)] * 5


@pytest.mark.parametrize("closed", [True, False], ids=["loop", "open"])
def test_a_flight_of_sound_rules_has_no_fault(closed: bool, soak: ModuleType):
    world = handmade.ring() if closed else handmade.canal(length_m=60.0)
    assert soak.fly([world], EnvConfig(observation="none"), 400, seed=0, vehicles=8).faults == []


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda state, rows: state.pose.__setitem__((rows, 2), 40.0), "a height outside the band"),
        (lambda state, rows: state.pose.__setitem__((rows, 0), 500.0), "a place beyond the bank"),
        (lambda state, rows: state.idle.__setitem__(rows, 50), "more idle steps than are allowed"),
        (lambda state, rows: state.steps.__setitem__(rows, 9), "steps of an episode that are not counted"),
        (lambda state, rows: state.visited_count.__setitem__(rows, 999), "visited segments that are not those counted"),
    ],
)
def test_an_illegal_state_is_noticed(spoil: Callable, words: str, soak: ModuleType):
    watch = soak.fly([handmade.ring()], EnvConfig(observation="none"), 8, seed=0, vehicles=8)
    watch.state()
    assert watch.faults == []
    spoil(watch.env.state, 3)
    watch.state()
    assert any(fault.startswith(words) and "vehicle 3" in fault for fault in watch.faults)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"reward": np.nan}, "a number that is not finite"),
        ({"reward": 11.0}, "a return above the greatest one"),
        ({"costs": -0.1}, "a negative cost"),
        ({"costs": 1.5}, "a cost of more than 1"),
        ({"progress": 1.1}, "a progress outside 0 to 1"),
        ({"done_reason": 3}, "an end without a reason, or a reason without an end"),
    ],
)
def test_an_illegal_outcome_is_noticed(change: dict, words: str, soak: ModuleType):
    watch = soak.fly([handmade.ring()], EnvConfig(observation="none"), 8, seed=0, vehicles=8)
    info = {
        "costs": np.zeros((8, 2)), "cost": np.zeros(8), "pose": np.zeros((8, 4)), "progress": np.zeros(8),
        "done_reason": np.full(8, -1),
    }  # fmt: skip
    reward, ended = np.zeros(8), np.zeros(8, bool)
    for name, value in change.items():
        (reward if name == "reward" else info[name])[2] = value
    watch.step(reward, ended, info)
    assert any(fault.startswith(words) and "vehicle 2" in fault for fault in watch.faults)


def test_an_episode_that_never_ends_is_noticed(soak: ModuleType):
    watch = soak.fly([handmade.ring()], EnvConfig(observation="none", max_steps=30), 8, seed=0, vehicles=8)
    watch.lengths[:] = 30
    still = {
        "costs": np.zeros((8, 2)), "cost": np.zeros(8), "pose": np.zeros((8, 4)), "progress": np.zeros(8),
        "done_reason": np.full(8, -1),
    }  # fmt: skip
    watch.step(np.zeros(8), np.zeros(8, bool), still)
    assert watch.faults[0].startswith("an episode above its step limit")


def test_frames_of_a_river_have_no_fault(soak: ModuleType, monkeypatch: pytest.MonkeyPatch):
    loop = World.from_centerline(course(circle(20.0, 48), 6.0), plants=False, seed=4)
    rivers = SimpleNamespace(world=lambda river: loop)
    monkeypatch.setattr(soak, "river_list", lambda piece, rivers_of_it: rivers)
    assert list(soak.soak_frames(0, 1, 2, batch=2)) == []


class Drawer:
    """Draws two frames of noise at a distance of 2 m, with sky in their first row."""

    def __init__(self, changes: dict[str, float]) -> None:
        self.changes = changes
        self.random = np.random.default_rng(0)

    def render_layers(self, poses: np.ndarray, time_s: np.ndarray) -> SimpleNamespace:
        kind = np.full((2, 4, 4), SKY + 1, np.uint8)
        kind[:, 0] = SKY
        depth = np.where(kind == SKY, -1.0, 2.0)
        frame = {"rgb": np.arange(96.0).reshape(2, 4, 4, 3), "depth_m": depth, "class_id": kind, "mask": kind}
        for name, value in self.changes.items():
            frame[name][1] = self.random.random() if np.isinf(value) else value
        return SimpleNamespace(**frame)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, ""),
        ({"rgb": 7}, "a frame of one colour"),
        ({"depth_m": 2.0}, "a depth that is no distance"),
        ({"depth_m": -1.0}, "a depth that is no distance"),
        ({"depth_m": np.nan}, "a depth that is no distance"),
    ],
)
def test_a_fault_of_a_frame_is_noticed(changes: dict, words: str, soak: ModuleType):
    poses, times = np.zeros((2, 4)), np.array([0.0, 12.5])
    faults = list(soak.frame_faults(Drawer(changes), poses, times, 1))
    assert faults == ([f"{words} at [0.0, 0.0, 0.0, 0.0], 12.500 s"] if words else [])


def test_a_frame_that_is_drawn_otherwise_the_second_time_is_noticed(soak: ModuleType):
    faults = list(soak.frame_faults(Drawer({"rgb": np.inf}), np.zeros((2, 4)), np.zeros(2), 0))
    assert faults[-1] == "another rgb when it is drawn again"
