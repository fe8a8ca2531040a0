"""Evaluation of policies that see images themselves: what is drawn for them, and that flights do not mix."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from tests.env import handmade
from tests.image_policies import image_policy
from thalweg.algos.policy.policy import Policy
from thalweg.bench.evaluate.baselines import BASELINES, sight_of
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, Step, evaluate, image_frames, observation_function
from thalweg.env import EnvConfig, RiverVectorEnv, sample_starts
from thalweg.render import Camera, Renderer
from thalweg.render.records.appearance import PARAMETERS, Look
from thalweg.render.records.randomisation import Randomisation
from thalweg.world import World

CONFIG = EvaluationConfig(episodes=6)
LABEL = Label("tester", 3, "Easy")


class SmallRenderer(handmade.BlankRenderer):
    """Draws the pose, also into masks, and writes down the channels that it was asked for."""

    def __init__(self) -> None:
        super().__init__()
        self.camera = SimpleNamespace(**vars(Camera()) | vars(self.camera))  # smaller than a camera may be
        self.channels: list[int] = []

    def render_tensors(self, views: Any, out: torch.Tensor) -> None:
        self.channels.append(out.shape[-1])
        super().render_tensors(views, out)

    def render(self, *given: Any, **named: Any) -> np.ndarray:
        frames = super().render(*given, **named)
        frames[..., 3] = frames[..., 0]
        return frames


def course() -> Course:
    ring = handmade.ring()
    return Course(ring, sample_starts(ring, 6, 0), np.linspace(0, 50, 6), np.arange(6))


def images(scene: World | Course, observation: str, renderer: Any = None) -> Any:
    given: Any = renderer or SmallRenderer()
    return image_frames(scene, observation, given)


class Forgetful:
    """Treats every image as the first of an episode, so that it knows no last action."""

    about = image_policy("rgb").about

    def __init__(self, policy: Policy) -> None:
        self.policy = policy

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        return self.policy.player(1, deterministic=deterministic, generator=generator)(obs, np.ones(1, dtype=bool))


@pytest.mark.parametrize("memory", [0, 4])
@pytest.mark.parametrize("observation", ["rgb+mask", "rgb", "mask"])
def test_an_episode_does_not_depend_on_the_others_of_the_batch(observation: str, memory: int):
    policy, whole, told = image_policy(observation, 8, memory=memory), course(), []
    together = evaluate(policy, whole, LABEL, CONFIG, observe=images(whole, observation), on_step=told.append)
    assert len({len(step.flying) for step in told}) > 1  # they did end at different times
    places = list(reversed(range(6)))
    singles = [whole.only(place) for place in places]
    alone = [evaluate(policy, one, LABEL, CONFIG, observe=images(one, observation))[0] for one in singles]
    assert together == alone[::-1]
    assert together != evaluate(Forgetful(policy), whole, LABEL, CONFIG, observe=images(whole, observation))


@pytest.mark.parametrize(("observation", "drawn", "channels"), [("rgb+mask", 4, 4), ("rgb", 4, 3), ("mask", 1, 1)])
def test_images_are_those_of_the_environment_and_only_masks_are_drawn_for_masks(
    observation: Any, drawn: int, channels: int
):
    starts = np.array([[x, 0.0, 5.0, 0.0] for x in (5.0, 15.0, 25.0)])
    whole, renderer = Course(handmade.canal(), starts, np.array([0.0, 7.0, 31.0]), np.arange(3)), SmallRenderer()
    seen, ahead = [], np.tile([1, 1, 0, 1], (3, 1))
    see = images(whole, observation, renderer)

    class Ahead:
        about = image_policy(observation).about

        def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
            return ahead[:1]

    evaluate(Ahead(), whole, LABEL, CONFIG, observe=lambda step: seen.append(see(step)) or seen[-1])
    assert set(renderer.channels) == {drawn}
    env = RiverVectorEnv([whole.world], 3, EnvConfig(observation=observation), renderer=SmallRenderer())
    env.reset(seed=0, options={"pose": whole.starts})
    env.set_state({**env.get_state(), "time_s": whole.clocks_s})
    for found in seen[1:4]:
        shown, *_ = env.step(ahead)
        assert found.dtype == np.uint8 and found.shape == (3, 8, 8, channels)
        np.testing.assert_array_equal(found, shown)


@pytest.mark.slow
@pytest.mark.parametrize(("observation", "part"), [("rgb+mask", slice(4)), ("rgb", slice(3)), ("mask", slice(3, 4))])
def test_each_start_is_drawn_in_its_own_appearance_and_sun(easy_world: World, observation: str, part: slice):
    ranges = Randomisation.only(haze=(0.3, 6.0), pitch_deg=(-9.0, -3.0), sun_azimuth_deg=(0.0, 360.0), suns=2)
    varied = Course.on(easy_world, CONFIG).varied(ranges, CONFIG)
    assert varied.looks is not None and varied.suns is not None
    rows = np.array([4, 0, 2])
    looks = [Look(**dict(zip(PARAMETERS, row, strict=True))) for row in varied.looks[rows]]
    poses, times = varied.starts[rows], varied.clocks_s[rows]
    drawn = Renderer(list(varied.lights)).render(poses, world_index=varied.suns[rows], time_s=times, look=looks)
    found = image_frames(varied, observation)(Step(rows, poses, times, np.zeros(3)))
    np.testing.assert_array_equal(found, drawn[..., part])
    usual = image_frames(easy_world, observation)(Step(rows, poses, times, np.zeros(3)))
    assert (found != usual).any(axis=(1, 2, 3)).sum() >= 2  # a mask without water looks the same in any


class Encoder:
    """An encoder whose codes are the means of what it is given."""

    device, inputs = torch.device("cpu"), "rgb+mask"

    def of_tensor(self, frames: torch.Tensor) -> torch.Tensor:
        return frames.float().mean((1, 2))


ENCODER: Any = Encoder()


def test_a_policy_is_shown_what_it_was_trained_on(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("thalweg.bench.evaluate.evaluation.Renderer", lambda *_, **__: SmallRenderer())
    whole = course()
    step = Step(np.array([1, 3]), whole.starts[[1, 3]], whole.clocks_s[[1, 3]], np.zeros(2))
    policies: list[Any] = [SimpleNamespace(), image_policy("rgb"), image_policy("mask"), *BASELINES.values()]
    seen = [observation_function(policy, whole, ENCODER) for policy in policies]
    assert [observe and observe(step).shape for observe in seen] == [
        (2, 4), (2, 8, 8, 3), (2, 8, 8, 1), *[None] * len(BASELINES),
    ]  # fmt: skip


def test_a_policy_of_codes_is_shown_nothing_without_an_encoder():
    policy: Any = SimpleNamespace()
    with pytest.raises(ValueError, match="sees frames through an encoder: give one"):
        observation_function(policy, course(), None)


def test_other_images_do_not_exist():
    with pytest.raises(ValueError, match=r"images are rgb\+mask, rgb, mask, not 'frames'"):
        image_frames(course(), "frames")


def test_a_policy_of_images_needs_an_observation_function():
    assert sight_of(image_policy()) == "images"
    with pytest.raises(ValueError, match=r"sees images: give `observe`, such as image_frames\("):
        evaluate(image_policy(), course(), LABEL, CONFIG)
