"""Tests of who flies: the hand, the pilots and recorded flights."""

import numpy as np
import pytest

from tests.viewer.flight.conftest import Fly
from thalweg.env import ConfigError, EnvConfig
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.flyers import Hand, Pilot, Replay, action_of
from thalweg.viewer.flight.recording import Recording


@pytest.mark.parametrize(
    ("options", "units", "action"),
    [
        ({}, (1, 0, 1, -1), [0, 1, 0, 2]),  # up, forward, right
        ({}, (0.4, -0.6, 0.2, 0), [1, 2, 1, 1]),  # the nearest options
        ({"action": "continuous"}, (0.4, -0.6, 1, 0), [0.4, -0.6, 1, 0]),
        ({"task": "Swimmers"}, (0, 0, -1, 0), [1, 1, 2, 1]),  # a fast step
        ({"task": "Swimmers", "action": "continuous"}, (0, 0, -1, 0), [0, 0, 1, 0]),
        ({"task": "Swimmers", "action": "continuous"}, (0, 0, 1, 0), [0, 0, 0.5, 0]),
    ],
)
def test_what_a_hand_does_is_an_action_of_the_space(options: dict, units: tuple, action: list):
    assert action_of(EnvConfig(observation="none", **options), units) == pytest.approx(action)


def test_a_key_that_is_released_before_the_next_step_counts_for_one_step(fly: Fly):
    flight, hand = fly(), Hand()
    hand.hold((0, 1, 0, 0))
    hand.hold((0, 0, 1, 0))
    hand.hold((0, 0, 0, 0))
    assert hand.action(flight).tolist() == [1, 0, 0, 1]
    assert hand.action(flight).tolist() == [1, 1, 1, 1]


def test_a_key_that_is_held_counts_for_every_step_and_the_last_one_wins(fly: Fly):
    flight, hand = fly(), Hand()
    hand.hold((0, 1, 0, 0))
    hand.hold((0, -1, 0, 0))
    assert [hand.action(flight).tolist() for _ in range(2)] == [[1, 2, 1, 1]] * 2


def test_a_pilot_flies_as_the_environment_says(fly: Fly):
    flight = fly(seed=2)
    assert np.array_equal(Pilot("pilot").action(flight), flight.env.pilot_actions("scripted")[0])
    with pytest.raises(ConfigError, match="unknown pilot 'steady' of the asv"):
        Pilot("steady").action(fly(vehicle="asv"))


def recorded(fly: Fly, **options) -> Recording:
    flight, pilot = fly(**options), Pilot("pilot")
    for _ in range(6):
        flight.step(pilot.action(flight), "pilot")
    return Recording.of(flight)


def test_a_replay_repeats_a_flight_and_ends_with_it(fly: Fly):
    recording, flight = recorded(fly, seed=3), fly(seed=3)
    replay = Replay(recording, flight)
    while (action := replay.action(flight)) is not None:
        flight.step(action, "replay")
    assert np.array_equal(flight.poses, recording.poses)


def test_a_replay_that_goes_otherwise_stops_with_its_step(fly: Fly):
    recording, flight = recorded(fly, seed=3), fly(seed=3)
    recording.poses[2] += 1e-9
    replay = Replay(recording, flight)
    with pytest.raises(ViewerError, match=r"goes otherwise here from step 2 on \(on this machine\)"):
        while (action := replay.action(flight)) is not None:
            flight.step(action, "replay")


def test_a_replay_begins_at_the_start(fly: Fly):
    flight = fly(seed=3)
    flight.step(np.array([1, 1, 0, 1]), "hand")
    with pytest.raises(ViewerError, match="from its start only"):
        Replay(recorded(fly, seed=3), flight)
