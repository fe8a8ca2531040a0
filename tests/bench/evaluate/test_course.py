"""Courses: the fixed starts of a level's rivers, and what they are drawn from."""

import zlib
from dataclasses import replace

import numpy as np
import pytest

from tests.env import handmade
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.evaluate.course import UNSEEN, Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, evaluate
from thalweg.env.initial_poses import CLOCK_RANGE_S
from thalweg.train.encoder.frames import sample_views
from thalweg.world import level_named

CONFIG = EvaluationConfig(episodes=6)
LABEL = Label("tester", 3, "Easy")


def test_a_longer_list_of_starts_begins_with_the_shorter_one(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("thalweg.bench.evaluate.course.load_or_build", lambda level, seed: handmade.ring())
    few, many = (Course.of_level("easy", EvaluationConfig(episodes=count)) for count in (5, 20))
    np.testing.assert_array_equal(few.starts, many.starts[:5])
    np.testing.assert_array_equal(few.clocks_s, many.clocks_s[:5])


def test_numbers_may_be_those_of_numpy():
    given = EvaluationConfig(episodes=np.int64(4), starts_seed=np.uint32(2), deterministic=np.True_)  # pyright: ignore
    assert given == EvaluationConfig(episodes=4, starts_seed=2, deterministic=True)
    assert (type(given.episodes), type(given.starts_seed), given.deterministic) == (int, int, True)


def test_no_start_is_a_pose_that_an_encoder_was_trained_on(monkeypatch: pytest.MonkeyPatch):
    ring = handmade.ring()
    monkeypatch.setattr("thalweg.bench.evaluate.course.load_or_build", lambda level, seed: ring)
    found = Course.of_level("Medium", EvaluationConfig())
    poses, _, clocks = sample_views([ring], 200, seed=0)
    assert not {tuple(pose) for pose in found.starts} & {tuple(pose) for pose in poses}
    assert not set(found.clocks_s) & set(clocks)


def test_starts_and_clocks_use_different_random_streams(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("thalweg.bench.evaluate.course.load_or_build", lambda level, seed: handmade.ring())
    drawn = {seed: Course.of_level("Medium", EvaluationConfig(starts_seed=seed)).clocks_s.tolist() for seed in range(3)}
    assert len({value for clocks in drawn.values() for value in clocks}) == 60
    # A seed alone gives the numbers of the seed and 0, which are those of the first start.
    seed = zlib.crc32(b"evaluation")
    of_starts = [CLOCK_RANGE_S * np.random.default_rng([seed, start]).random(64) for start in range(20)]
    assert not {*drawn[0]} & {*np.ravel(of_starts)}


@pytest.mark.parametrize(("wrong", "said"), [({"starts_seed": -1}, "starts_seed"), ({"episodes": 0}, "episodes")])
def test_invalid_evaluation_configs_are_refused(wrong: dict, said: str):
    with pytest.raises(ResultsError, match=f"{said} must be"):
        EvaluationConfig(**wrong)


def test_unseen_courses_are_other_rivers_of_the_level_with_one_start_each(monkeypatch: pytest.MonkeyPatch):
    built = []

    def river(level, seed: int):
        built.append((level.name, seed))
        return replace(handmade.canal(length_m=60.0), seed=seed)

    monkeypatch.setattr("thalweg.bench.evaluate.course.load_or_build", river)
    config = replace(CONFIG, episodes=3)
    made = Course.unseen("easy", config)
    assert next(made).world.seed == UNSEEN and built == [("Easy", UNSEEN)]  # the others when their turn comes
    built.clear()
    courses = list(Course.unseen("easy", config))
    assert built == [("Easy", UNSEEN + place) for place in range(3)]
    assert [course.starts.shape for course in courses] == [(1, 4)] * 3
    assert [course.indices.tolist() for course in courses] == [[0], [1], [2]]
    rows = [row for course in courses for row in evaluate(BASELINES["hover"], course, LABEL, config)]
    assert [(row.world_seed, row.episode) for row in rows] == [(UNSEEN + place, place) for place in range(3)]
    assert [course.clocks_s.shape for course in courses] == [(1,)] * 3
    own = np.concatenate([course.starts for course in courses])
    assert all(len(np.unique(column)) == 3 for column in own.T)  # the rivers are alike, their starts are not
    again = Course.unseen("Easy", config)
    assert all(np.array_equal(one.starts, other.starts) for one, other in zip(courses, again, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("level", ["Medium", "Hard"])
def test_flights_are_the_same_on_a_river_without_land(level: str):
    for name in ("pilot", "forward", "random"):
        whole, bare = (Course.of_level(level, CONFIG, drawn=drawn) for drawn in (True, False))
        assert whole.world.ground_m.size > bare.world.ground_m.size
        np.testing.assert_array_equal(whole.starts, bare.starts)
        rows = [evaluate(BASELINES[name], found, LABEL, CONFIG) for found in (whole, bare)]
        assert rows[0] == rows[1]


@pytest.mark.parametrize("unseen", [False, True])
def test_a_river_that_nobody_sees_is_not_built(unseen: bool, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("thalweg.bench.evaluate.course.load_or_build", None)
    found = Course.unseen("Easy", CONFIG, drawn=False) if unseen else [Course.of_level("Easy", CONFIG, drawn=False)]
    whose = [UNSEEN + index for index in range(6)] if unseen else [level_named("Easy").default_seed]
    assert [course.world.seed for course in found] == whose
