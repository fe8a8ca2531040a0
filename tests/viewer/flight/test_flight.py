"""A flight of the page is an episode of the environment, to the bit."""

import io

import gymnasium
import numpy as np
import pytest
from PIL import Image

import thalweg  # noqa: F401  # registers the environments
from tests.viewer.flight.conftest import Fly
from thalweg.render import Camera
from thalweg.viewer.flight.flight import Flight
from thalweg.viewer.flight.pictures import pictures

ACTIONS = [[1, 0, 0, 1], [0, 1, 0, 2], [2, 2, 0, 0], [1, 1, 0, 1], [1, 1, 2, 1], [1, 0, 0, 0]] * 5


def flown(flight: Flight, actions: list[list[int]]) -> Flight:
    for action in actions:
        if not flight.ended:
            flight.step(np.array(action), "hand")
    return flight


@pytest.mark.parametrize("options", [{}, {"task": "Swimmers"}, {"wind_m_per_s": 2.0}], ids=["river", "task", "wind"])
def test_a_flight_is_the_episode_of_the_environment(fly: Fly, options: dict):
    flight = flown(fly(seed=5, **options), ACTIONS)
    rules = flight.options.rules
    env = gymnasium.make("thalweg/Easy-v0", task=rules.task, wind=rules.wind, camera=Camera(32, 32)).unwrapped
    frame, info = env.reset(seed=5)
    poses, rewards, costs = [info["pose"]], [], []
    for action in ACTIONS[: flight.steps]:
        frame, reward, _, _, info = env.step(action)
        poses.append(info["pose"])
        rewards.append(reward)
        costs.append(info["costs"])
    assert np.array_equal(flight.poses, poses)
    assert flight.rewards == rewards
    assert np.array_equal(flight.costs, costs)
    assert flight.reason == info["done_reason"]
    mask = Image.open(io.BytesIO(pictures(flight, ["mask"])["mask"]))
    assert np.array_equal(np.asarray(mask) * 255, frame[..., 3])


def test_a_flight_in_the_environment_of_another_is_that_of_a_new_one(fly: Fly):
    first = flown(fly(seed=5, task="Swimmers", look="random"), ACTIONS[:4])
    again = flown(Flight(first.env, first.options), ACTIONS[:4])
    assert np.array_equal(first.poses, again.poses)
    assert first.times_s == again.times_s
    assert pictures(fly(seed=5, task="Swimmers", look="random"), ["camera"]) == pictures(
        Flight(first.env, first.options), ["camera"]
    )


def test_the_camera_moves_evenly_through_a_step_and_turns_the_short_way(fly: Fly):
    flight = flown(fly(seed=5), ACTIONS[:1])
    flight.poses[-2:] = [np.array([0.0, 0.0, 4.0, 3.1]), np.array([1.0, 2.0, 6.0, -3.1])]
    views = flight.views(0.25)
    short = 2 * np.pi - 6.2
    assert views.pose[0] == pytest.approx([0.25, 0.5, 4.5, 3.1 + 0.25 * short])
    assert views.time_s[0] == pytest.approx(flight.times_s[-2] + 0.25 * 0.25)  # a step takes 0.25 s
    assert np.array_equal(flight.views().pose, flight.env.state.pose)


def test_the_status_sums_what_was_paid_and_names_the_end(fly: Fly):
    flight = fly(seed=5)
    assert (flight.status()["return"], flight.status()["ended"]) == (0.0, "")
    while not flight.ended:
        flight.step(np.array([0, 1, 1, 1]), "hand")  # up
    told = flight.status()
    assert told["ended"] == "too low or high"
    assert told["costs"] == {"tight": 1.0, "loose": 0.0}
    assert told["height_m"] == pytest.approx(
        flight.poses[-1][2] - flight.world.river.level_m[0], abs=0.005
    )  # Easy is level
    assert (told["step"], told["max_steps"], told["pilot"]) == (flight.steps, 500, "hand")
