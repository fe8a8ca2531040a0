"""Flights through the socket: the same as in the environment, recorded, watched, and safe from what a page may send."""

import errno
import os

import gymnasium
import numpy as np
import pytest
from starlette.websockets import WebSocketDisconnect

import thalweg  # noqa: F401  # registers the environments
from tests.viewer.server.conftest import Server
from thalweg.viewer.server.app import MOST_TABS
from thalweg.viewer.server.tab import MOST_A_SECOND

UNITS = [(0, 1, 1, 0), (1, 0, 1, -1), (-1, -1, 1, 1), (0, 0, 0, 0), (0, 0, 1, 0)]


def test_a_page_is_told_what_there_is_to_choose_and_gets_a_first_picture(server: Server):
    with server.open() as page:
        hello = page.until("hello")
        assert hello["pilots"] == ["hand", "pilot", "steady", "forward"]
        assert hello["levels"]["asv"] == ["Easy", "Medium-Deep", "Hard-Deep"]
        assert hello["options"]["level"] == "Easy"
        started = page.until("started")
        assert started["options"]["world_seed"] == 1 and started["cost_kinds"] == ["tight", "loose"]
        frame = page.until("frame")
        assert (frame["step"], frame["moving"], list(frame["images"])) == (0, False, ["camera", "mask"])


def test_a_flight_through_the_socket_is_that_of_the_environment(server: Server):
    with server.flying() as page:
        for step, units in enumerate(UNITS, start=1):
            page.say("step", action=units)
            frame = page.at_step(step)
        page.say("save")
        recording = server.folder.read(page.until("saved")["name"])
    env = gymnasium.make("thalweg/Easy-v0").unwrapped
    _, info = env.reset(seed=3)
    poses, rewards = [info["pose"]], []
    for units in UNITS:
        _, reward, _, _, info = env.step(1 - np.array(units))
        poses.append(info["pose"])
        rewards.append(reward)
    assert np.array_equal(recording.poses, poses)
    assert recording.rewards.tolist() == rewards
    assert set(recording.pilots) == {"hand"}
    assert frame["pose"] == pytest.approx(poses[-1], abs=0.0005)


def test_a_saved_flight_is_replayed_on_the_page(server: Server):
    with server.flying() as page:
        for step, units in enumerate(UNITS, start=1):
            page.say("step", action=units)
            last = page.at_step(step)
        page.say("save")
        name = page.until("saved")["name"]
        assert page.until("flights")["names"] == [name]
        page.say("replay", name=name)
        page.until("started")
        page.say("run", paused=False, speed=None)
        assert page.at_step(len(UNITS))["pose"] == last["pose"]
        assert "is over; hand flies" in page.until("busy")["message"]


def test_a_flight_that_a_single_step_ends_is_told_of_when_it_is_saved(server: Server):
    heard = []
    with server.flying() as page:
        page.say("record", on=True)
        for step in range(1, 60):  # to the left, until the bank ends the flight
            page.say("step", action=(0, 0, 0, 1))
            while (told := page.hear())["type"] != "frame" or told["step"] < step:
                heard.append(told)
            if told["ended"]:
                break
    (saved,) = [told["name"] for told in heard if told["type"] == "saved"]
    assert [told["names"] for told in heard if told["type"] == "flights"][-1] == [saved]


def test_a_flight_goes_on_by_itself_until_it_is_paused(server: Server):
    with server.flying() as page:
        page.say("control", pilot="pilot")
        page.say("run", paused=False, speed=16.0)
        assert page.at_step(6)["flies"] == "pilot"
        page.say("run", paused=True)
        while page.until("pace")["moving"]:
            pass
        paused = page.until("frame")["step"]
        page.say("view", picture="depth", mask=False)
        frame = page.until("frame")
        assert (frame["step"], list(frame["images"])) == (paused, ["depth"])


def test_the_fastest_flight_waits_between_its_frames(server: Server, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("thalweg.viewer.server.tab.MOST_FRAMES_PER_S", 1e-3)
    with server.flying() as page:
        page.say("control", pilot="pilot")
        page.say("run", paused=False, speed=None)
        page.at_step(1)
        for _ in range(9):  # without the wait, each answer brings a frame, and the flight goes on
            page.say("save")
            name = page.until("saved")["name"]
        assert len(server.folder.read(name).actions) == 1


def test_what_is_held_flies(server: Server):
    with server.flying() as page:
        page.say("hold", action=(1, 0, 0, 0))
        page.say("run", paused=False, speed=8.0)
        assert page.at_step(3)["action"] == [0, 1, 1, 1]  # up


def test_the_end_of_a_flight_is_named_and_saved_if_asked_for(server: Server):
    with server.flying() as page:
        page.say("record", on=True)
        page.say("hold", action=(1, 0, 0, 0))
        page.say("run", paused=False, speed=None)
        name = page.until("saved")["name"]
        frame = page.until("frame")
        while not frame["ended"]:
            frame = page.until("frame")
        assert frame["ended"] == "too low or high" and frame["costs"] == {"tight": 1.0, "loose": 0.0}
    assert server.folder.names() == [name]
    assert (server.folder.path / "episodes.csv").read_text().count("\n") == 2


def test_the_end_is_shown_of_a_flight_that_cannot_be_saved(server: Server, monkeypatch: pytest.MonkeyPatch):
    def save(flight: object) -> str:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "flights")

    monkeypatch.setattr(server.folder, "save", save)
    with server.flying() as page:
        page.say("record", on=True)
        page.say("hold", action=(1, 0, 0, 0))
        page.say("run", paused=False, speed=None)
        while (told := page.hear())["type"] != "error":
            pass
        assert told["message"] == f"flights cannot be used: {os.strerror(errno.ENOSPC)}"
        assert page.until("frame")["ended"] == "too low or high"


@pytest.mark.parametrize(
    ("message", "error"),
    [
        ({"type": "start", "options": {"level": "Eazy"}}, "unknown river 'Eazy'"),
        ({"type": "start", "options": {"level": "../../etc"}}, "unknown river"),
        ({"type": "start", "options": {"dynamics": "inertial"}}, "needs action='continuous'"),
        ({"type": "start", "options": {"levl": "Easy"}}, "FlightOptions has no 'levl' (did you mean 'level'?)"),
        ({"type": "replay", "name": "../secret"}, "no flight '../secret'"),
        ({"type": "control", "pilot": "nobody"}, "unknown pilot 'nobody'"),
        ({"type": "save"}, "nothing has been flown yet"),
        ({"type": "fly"}, "unknown type of message 'fly'"),
    ],
)
def test_a_wish_that_cannot_be_met_is_named_and_the_flight_goes_on(server: Server, message: dict, error: str):
    with server.flying() as page:
        page.say(message.pop("type"), **message)
        while (told := page.hear())["type"] != "error":
            pass
        assert error in told["message"]
        page.say("step", action=(0, 0, 1, 0))
        assert page.at_step(1)["flies"] == "hand"


def test_bytes_and_other_nonsense_do_not_end_a_tab(server: Server):
    with server.flying() as page:
        page.socket.send_bytes(b"\x00\xff")
        assert "must be text" in page.hear()["message"]
        page.socket.send_text("{")
        assert "must be JSON" in page.hear()["message"]
        page.say("step", action=(0, 0, 1, 0))
        assert page.at_step(1)["step"] == 1


def test_a_flood_is_cut_off(server: Server):
    with pytest.raises(WebSocketDisconnect) as cut, server.flying() as page:
        for _ in range(2 * MOST_A_SECOND):
            page.say("hold", action=(0, 0, 0, 0))
        while True:
            event = page.socket.receive()
            if event["type"] == "websocket.close":
                raise WebSocketDisconnect(event["code"])
    assert cut.value.code == 1008


def test_tabs_fly_side_by_side_up_to_their_greatest_number(server: Server):
    with server.flying() as one, server.flying() as other:
        one.say("step", action=(0, 1, 1, 0))
        other.say("step", action=(0, -1, 1, 0))
        poses = [page.at_step(1)["pose"] for page in (one, other)]
        assert poses[0] != poses[1]
        more = [server.open() for _ in range(MOST_TABS - 2)]
        for each in more:
            each.__enter__()
        with server.open() as late:
            assert late.socket.receive()["code"] == 1013
        for each in more:
            each.__exit__(None, None, None)
