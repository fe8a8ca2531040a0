"""Courses with one start each are flown together, and every episode is that of its course alone."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.env import handmade
from thalweg.bench.evaluate.baselines import BASELINES, Sight
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, Step, evaluate, image_frames
from thalweg.render.records.randomisation import Randomisation
from thalweg.world import World

CONFIG = EvaluationConfig(episodes=4)
LABEL = Label("tester", 3, "Easy")


def on(worlds: list[World]) -> list[Course]:
    """The i-th start of the i-th world."""
    return [Course.on(world, CONFIG).only(index) for index, world in enumerate(worlds)]


class Wanderer:
    """Samples its actions, so that flights end at different times; sees nothing."""

    sees: Sight = "nothing"

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        drawn = torch.randint(3, (len(obs), 4), generator=generator).numpy()
        drawn[:, 2] = np.where(drawn[:, 2] > 0, 0, 1)
        return drawn


def test_episodes_are_those_of_each_course_alone():
    worlds = [
        replace(world, seed=seed)
        for seed, world in enumerate([handmade.ring(), handmade.canal(), handmade.hairpin(), handmade.ring()])
    ]
    courses = on(worlds)
    together = evaluate(Wanderer(), Course.joined(courses), LABEL, CONFIG)
    assert together == [evaluate(Wanderer(), course, LABEL, CONFIG)[0] for course in courses]
    assert [(row.world_seed, row.episode) for row in together] == [(0, 0), (1, 1), (2, 2), (3, 3)]
    assert len({row.length for row in together}) > 1


def seen(course: Course) -> np.ndarray:
    """Return what a policy of images sees at the starts."""
    count = len(course.starts)
    return image_frames(course, "rgb+mask")(Step(np.arange(count), course.starts, course.clocks_s, np.zeros(count)))


@pytest.mark.slow
@pytest.mark.parametrize("looks", [None, Randomisation(suns=2)])
def test_what_is_seen_is_that_of_each_course_alone(looks: Randomisation | None, easy_world: World):
    start = Course.on(easy_world, CONFIG).only(2)
    courses = [replace(start, world=replace(easy_world.relit(2.0 * sun, 0.6), seed=sun)) for sun in range(3)]
    if looks is not None:
        courses = [course.varied(looks, CONFIG) for course in courses]
    together = seen(Course.joined(courses))
    assert np.array_equal(together, np.concatenate([seen(course) for course in courses]))
    assert len({frame[..., :3].tobytes() for frame in together}) == 3


def test_some_starts_of_a_course():
    course = Course.on(handmade.ring(), CONFIG)
    some = course.those([3, 1])
    assert some.indices.tolist() == [1, 3]
    assert np.array_equal(some.starts, course.starts[[1, 3]]) and np.array_equal(some.clocks_s, course.clocks_s[[1, 3]])
    joined = Course.joined(on([replace(handmade.ring(), seed=seed) for seed in range(3)]))
    assert [world.seed for world in joined.those([2, 0]).rivers] == [0, 2]


def test_courses_with_several_starts_and_of_both_kinds_are_refused():
    whole = Course.on(handmade.ring(), CONFIG)
    with pytest.raises(ValueError, match=r"one start each can be joined, not \[1, 4\]"):
        Course.joined([whole.only(0), whole])
    with pytest.raises(ValueError, match=r"not \[\]"):
        Course.joined([])
    varied = whole.varied(Randomisation(suns=0), CONFIG)
    with pytest.raises(ValueError, match="with appearances and without"):
        Course.joined([whole.only(0), varied.only(1)])


def test_pilots_fly_joined_courses():
    joined = Course.joined(on([handmade.ring(), handmade.canal()]))
    assert [row.reason for row in evaluate(BASELINES["pilot"], joined, LABEL, CONFIG)] == ["Success"] * 2
