"""The bird's-eye map: its cells by hand, beside the river's banks, and when it begins anew."""

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.env.shield.channel import Channel, optics_of, straight
from tests.viewer.flight.conftest import Fly
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.env import RiverVectorEnv
from thalweg.env.initial_poses import project_anywhere
from thalweg.env.shield.water_map import CELL_M
from thalweg.env.task.motion import Pose
from thalweg.env.task.termination import island_at, metres_past_bank
from thalweg.render import Camera
from thalweg.render.optics.lens import Lens
from thalweg.viewer.flight.cockpit import Cockpit
from thalweg.viewer.flight.eye import Eye
from thalweg.viewer.flight.flight import Flight, env_of
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.recording import Folder
from thalweg.viewer.flight.seen_water import (
    AHEAD_M,
    ASIDE_M,
    COLOURS,
    COLUMNS,
    DRY,
    ROWS,
    UNSEEN,
    VEHICLE,
    WATER,
    SeenWater,
)
from thalweg.world import World

EASY = FlightOptions(level="Easy", size_px=32, seed=3)


def at(x: float, y: float, yaw: float) -> np.ndarray:
    return np.array([x, y, 5.0, yaw])


@pytest.fixture
def canal() -> SeenWater:
    """What is seen of a canal 6 m wide along x, from six places on it."""
    water, channel = SeenWater(), Channel(straight(3.0))
    for x in range(6):
        water.enter(channel.mask(at(x, 0.0, 0.0)), Pose(*at(x, 0.0, 0.0)), optics_of(channel.camera))
    return water


@pytest.mark.parametrize(
    ("yaw", "row", "column"),
    [(0.0, 75, 63), (np.pi / 2, 95, 84), (np.pi, 116, 64), (-np.pi / 2, 96, 43)],
)
def test_a_cell_that_is_known_is_where_it_is_to_the_vehicle(yaw: float, row: int, column: int):
    # The middle of the cell is at (10.125, 0.125): from (5, 0) that is 5.125 m east and 0.125 m north.
    water = SeenWater()
    water.maps.odds[0, 40, 0] = 8
    assert np.argwhere(water.cells(at(5.0, 0.0, yaw)) != UNSEEN).tolist() == [[row, column]]


def test_a_canal_is_straight_ahead_of_who_flies_along_it(canal: SeenWater):
    cells = canal.cells(at(5.0, 0.0, 0.0))
    # Its banks are 3 m to either side: 12 cells from the middle, which is between columns 63 and 64.
    assert not (cells[:, :52] == WATER).any() and not (cells[:, 76:] == WATER).any()
    ten_ahead = cells[56]
    assert (ten_ahead[54:74] == WATER).all() and (ten_ahead[77:90] == DRY).all() and (ten_ahead[38:51] == DRY).all()
    assert (cells[104:, :] == UNSEEN).all()  # behind the first sight, 2 m ahead of the start


def test_the_same_canal_is_to_the_right_of_who_has_turned_left(canal: SeenWater):
    cells = canal.cells(at(5.0, 0.0, np.pi / 2))
    ten_right = cells[:, 103]
    assert (ten_right[86:106] == WATER).all() and (ten_right[70:83] == DRY).all() and (ten_right[109:122] == DRY).all()
    assert (cells[:, :40] == UNSEEN).all()


def test_what_leaves_the_window_is_unknown(canal: SeenWater):
    far = canal.cells(at(5.0 + 64.0, 0.0, 0.0))  # the same places in memory, another place on the river
    assert (far == UNSEEN).all()


def test_the_picture_has_a_pixel_for_each_cell_and_the_vehicle_at_its_place(canal: SeenWater):
    pose = at(5.0, 0.0, 0.0)
    picture = np.asarray(Image.open(io.BytesIO(canal.picture(pose))))
    expected = np.array(COLOURS, np.uint8)[canal.cells(pose)]
    arrow = (picture == VEHICLE).all(axis=2)
    assert np.array_equal(picture[~arrow], expected[~arrow])
    rows, columns = np.nonzero(arrow)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (89, 102, 59, 69)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        pytest.param({"look": "random", "seed": 5}, marks=pytest.mark.slow),
        {"vehicle": "asv"},
        {"dynamics": "inertial", "action": "continuous"},
    ],
    ids=["uav", "random look", "boat", "inertia"],
)
def test_water_in_a_flight_is_between_the_banks_of_the_river(fly: Fly, changes: dict[str, Any]):
    flight, water = fly(**changes), SeenWater()
    eye = Eye(flight, Camera())
    for _ in range(8):
        water.look(flight, eye)
        flight.step(flight.env.pilot_actions()[0], "pilot")
    pose, courses = flight.poses[-1], flight.env.courses
    cells = water.cells(pose)
    assert (cells == WATER).sum() > 300
    past = []
    for row, column in np.argwhere(cells == WATER):
        ahead, left = AHEAD_M - (row + 0.5) * CELL_M, ASIDE_M - (column + 0.5) * CELL_M
        x = pose[0] + ahead * np.cos(pose[3]) - left * np.sin(pose[3])
        y = pose[1] + ahead * np.sin(pose[3]) + left * np.cos(pose[3])
        projection = project_anywhere(courses, 0, x, y)
        past.append(metres_past_bank(courses, 0, projection) if island_at(courses, 0, x, y) < 0 else 9.0)
    assert np.mean(np.array(past) < 0.75) > 0.99


def bird_of(cockpit: Cockpit) -> np.ndarray:
    """The map [ROWS, COLUMNS, 3] of a cockpit's frame."""
    _, drawn = cockpit.frame("mask", 1.0, mask=False, seen=True)
    return np.asarray(Image.open(io.BytesIO(drawn["bird"])))


def known(picture: np.ndarray) -> int:
    """Number of cells that were seen."""
    return int((picture != COLOURS[UNSEEN]).any(axis=2).sum())


@pytest.fixture(scope="module")
def env(easy_world: World) -> RiverVectorEnv:
    """The environment of all cockpits here, whose pictures take seconds to prepare."""
    return env_of(easy_world, EASY)


@pytest.fixture
def cockpit(tmp_path: Path, easy_world: World, env: RiverVectorEnv) -> Cockpit:
    """A cockpit whose pilot has flown eight steps with the map shown."""
    cockpit = Cockpit({"forward": lambda: BASELINES["forward"]}, Folder(tmp_path), "pilot")
    cockpit.flight = Flight(env, EASY)  # the next one takes its environment
    cockpit.start(easy_world, EASY)
    cockpit.frame("mask", 1.0, mask=False, seen=True)
    cockpit.advance(8)
    return cockpit


def test_the_map_grows_with_each_step_and_begins_anew_with_a_flight(cockpit: Cockpit, easy_world: World):
    grown = known(bird_of(cockpit))
    cockpit.start(easy_world, EASY)
    first = bird_of(cockpit)
    assert first.shape == (ROWS, COLUMNS, 3)
    assert grown > 1.2 * known(first)
    cockpit.step_by_hand((0, 0, 1, 0))
    assert known(bird_of(cockpit)) > known(first)


def test_the_map_begins_anew_with_a_replay_and_grows_as_in_the_flight(cockpit: Cockpit, easy_world: World):
    flown, name = bird_of(cockpit), cockpit.save()
    cockpit.repeat(easy_world, cockpit.folder.read(name))
    assert known(bird_of(cockpit)) < known(flown)
    cockpit.advance(8)
    assert np.array_equal(bird_of(cockpit), flown)


def test_nothing_is_drawn_for_a_map_that_is_hidden(cockpit: Cockpit, monkeypatch: pytest.MonkeyPatch):
    grown, looks = known(bird_of(cockpit)), []
    see = Eye.see
    monkeypatch.setattr(Eye, "see", lambda *given: looks.append(0) or see(*given))
    _, drawn = cockpit.frame("camera", 1.0, mask=True, seen=False)
    cockpit.advance(3)
    assert looks == [] and "bird" not in drawn
    assert known(bird_of(cockpit)) < grown  # it was forgotten, and begins anew
    cockpit.advance(2)
    assert len(looks) == 3


def test_no_eye_of_an_earlier_flight_is_kept(cockpit: Cockpit, easy_world: World):
    first = cockpit._plain_eye
    cockpit.start(easy_world, EASY)
    assert cockpit._plain_eye is first is not None  # the environment is the same
    cockpit.control("forward")
    cockpit.start(easy_world, replace(EASY, action="continuous"))
    assert (cockpit._plain_eye, cockpit._eye) == (None, None)


def test_no_eye_is_kept_for_a_map_that_is_hidden(cockpit: Cockpit):
    assert cockpit._plain_eye is not None
    cockpit.frame("mask", 1.0, mask=False, seen=False)
    assert cockpit._plain_eye is None


def test_the_map_reads_the_camera_of_the_policy_and_refuses_one_with_a_lens(cockpit: Cockpit):
    cockpit.control("forward")
    flyer: Any = cockpit._flyer
    flyer.eye = Eye(cockpit.flight, Camera(lens=Lens("equidistant", (-0.02,))))  # pyright: ignore
    told, drawn = cockpit.frame("camera", 1.0, mask=True, seen=True)
    assert "bird" not in drawn and "a camera with a lens" in told["unmapped"]
    cockpit.advance(1)
    cockpit.control("pilot")
    told, drawn = cockpit.frame("camera", 1.0, mask=True, seen=True)
    assert "bird" in drawn and told["unmapped"] == ""
