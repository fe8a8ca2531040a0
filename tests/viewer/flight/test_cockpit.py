"""Tests of the cockpit: take-overs, replays, and what is saved when."""

from pathlib import Path

import numpy as np
import pytest

from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.cockpit import Cockpit
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.recording import Folder
from thalweg.world import World

EASY = FlightOptions(level="Easy", size_px=32, seed=3)


@pytest.fixture
def cockpit(tmp_path: Path, easy_world: World) -> Cockpit:
    cockpit = Cockpit({"mine": lambda: BASELINES["forward"]}, Folder(tmp_path))
    cockpit.start(easy_world, EASY)
    return cockpit


def test_everyone_can_take_over_in_a_flight(cockpit: Cockpit):
    for name in ("hand", "pilot", "mine", "hand", "steady"):
        cockpit.control(name)
        assert cockpit.advance(1)
    assert cockpit.flight is not None
    assert cockpit.flight.pilots == ["hand", "pilot", "mine", "hand", "steady"]
    assert [cockpit.flight.actions[step].tolist() for step in (0, 2)] == [[1, 1, 1, 1], [1, 1, 0, 1]]


LEFT, STILL = (0, 1, 0, 0), (0, 0, 0, 0)


def test_a_tap_is_flown_by_the_step_that_it_asked_for_alone(cockpit: Cockpit):
    cockpit.hand.hold(LEFT)
    cockpit.step_by_hand(LEFT)
    cockpit.hand.hold(STILL)
    assert cockpit.advance(1)
    assert [action.tolist() for action in cockpit.flight.actions] == [[1, 0, 1, 1], [1, 1, 1, 1]]  # pyright: ignore


@pytest.mark.parametrize("by", ["choice", "key", "end of a replay", "new flight"])
def test_a_tap_ends_with_whoever_flew_then(by: str, cockpit: Cockpit, easy_world: World):
    cockpit.control("pilot")
    cockpit.advance(1)
    if by == "end of a replay":
        cockpit.repeat(easy_world, cockpit.folder.read(cockpit.save()))
    cockpit.hand.hold(LEFT)
    cockpit.hand.hold(STILL)
    if by == "choice":
        cockpit.control("hand")
    elif by == "key":
        cockpit.step_by_hand(STILL)
    elif by == "end of a replay":
        assert not cockpit.advance(9)
    else:
        cockpit.pilot = "hand"
        cockpit.start(easy_world, EASY)
    assert cockpit.advance(1)
    assert cockpit.flight.actions[-1].tolist() == [1, 1, 1, 1]  # pyright: ignore


def test_an_unknown_pilot_is_named_with_those_that_there_are(cockpit: Cockpit):
    with pytest.raises(ViewerError, match=r"unknown pilot 'pilto' \(did you mean 'pilot'\?\); known: hand, pilot, "):
        cockpit.control("pilto")
    assert cockpit.pilot == "hand"


def test_a_pilot_that_the_vehicle_has_not_leaves_the_controls_where_they_were(cockpit: Cockpit, easy_world: World):
    cockpit.start(easy_world, FlightOptions(level="Easy", size_px=32, vehicle="asv"))
    cockpit.control("pilot")
    with pytest.raises(ValueError, match="unknown pilot 'steady' of the asv"):
        cockpit.control("steady")
    assert cockpit.pilot == "pilot"
    assert cockpit.advance(1)


def test_a_saved_flight_is_repeated_and_then_handed_over(cockpit: Cockpit, easy_world: World):
    cockpit.control("pilot")
    cockpit.advance(5)
    name, poses = cockpit.save(), list(cockpit.flight.poses)  # pyright: ignore
    cockpit.repeat(easy_world, cockpit.folder.read(name))
    assert cockpit.pilot == "replay"
    assert not cockpit.advance(9)  # it stands at the end of the recording
    assert np.array_equal(cockpit.flight.poses, poses)  # pyright: ignore
    assert cockpit.pilot == "hand"
    assert cockpit.advance(1)


def test_the_same_flight_is_saved_once(cockpit: Cockpit):
    cockpit.step_by_hand((0, 0, 1, 0))
    assert cockpit.save() == cockpit.save()
    cockpit.step_by_hand((0, 0, 1, 0))
    cockpit.save()
    assert len(cockpit.folder.names()) == 2


def test_all_flights_are_saved_at_their_end_if_asked_for(cockpit: Cockpit):
    cockpit.saves_all = True
    while not cockpit.flight.ended:  # pyright: ignore
        cockpit.step_by_hand((1, 0, 0, 0))
    assert len(cockpit.folder.names()) == 1
    assert not cockpit.advance(1)
    assert len(cockpit.folder.names()) == 1


def test_a_frame_has_the_pictures_that_were_asked_for(cockpit: Cockpit):
    told, drawn = cockpit.frame("depth", 1.0, mask=True, seen=True)
    assert list(drawn) == ["depth", "mask", "bird"]  # the hand sees no image of its own
    assert (told["flies"], told["step"]) == ("hand", 0)
    assert list(cockpit.frame("mask", 1.0, mask=True, seen=False)[1]) == ["mask"]


def test_nothing_can_be_done_without_a_flight(tmp_path: Path):
    empty = Cockpit({}, Folder(tmp_path))
    for act in (lambda: empty.advance(1), empty.save, lambda: empty.step_by_hand((0, 0, 0, 0))):
        with pytest.raises(ViewerError, match="there is no flight"):
            act()
