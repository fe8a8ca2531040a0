"""Conditions of evaluation: trials, result folders, varied appearance and refused values."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from tests.bench.small_backend import SUITE, SmallBackend
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import APPEARANCE, CONDITIONS, MAIN, SUN, Condition, Trial
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, Step, encoded_frames, evaluate
from thalweg.bench.execute.backend import RiverBackend
from thalweg.bench.execute.runner import run_suite
from thalweg.bench.report.report import problems
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.results import evaluation_path
from thalweg.bench.suite.arms import Arm, Run
from thalweg.bench.suite.builtin import SUITES
from thalweg.render import Renderer
from thalweg.render.records.appearance import PARAMETERS, Look
from thalweg.render.records.randomisation import Randomisation
from thalweg.world import World

pytestmark = pytest.mark.usefixtures("no_pictures")

CONFIG = EvaluationConfig(episodes=3)
USUAL = np.array([getattr(Look(), name) for name in PARAMETERS])


class RecordingEncoder:
    """An encoder that records its frames."""

    device = torch.device("cpu")

    def __init__(self, inputs: str = "rgb+mask") -> None:
        self.inputs = inputs
        self.frames: list[np.ndarray] = []

    def of_tensor(self, frames: torch.Tensor) -> torch.Tensor:
        self.frames.append(frames.numpy().copy())
        return torch.zeros(len(frames), 16)


class FlyAhead:
    """Flies straight ahead."""

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        return np.tile([1, 1, 0, 1], (len(obs), 1))


@pytest.mark.slow
def test_each_start_has_its_own_appearance_and_sun(easy_world: World):
    ranges = Randomisation.only(haze=(0.3, 6.0), warmth=(-0.6, 0.6), sun_azimuth_deg=(0.0, 360.0), suns=2)
    course = Course.on(easy_world, CONFIG).varied(ranges, CONFIG)
    assert course.looks is not None and course.suns is not None and len(course.lights) == 2
    encoder = RecordingEncoder()
    evaluate(FlyAhead(), course, Label("ahead", 0, "Easy"), CONFIG, observe=encoded_frames(course, encoder))  # pyright: ignore
    looks = [Look(**dict(zip(PARAMETERS, row, strict=True))) for row in course.looks]
    drawn = Renderer(list(course.lights)).render(
        course.starts, world_index=course.suns, time_s=course.clocks_s, look=looks
    )
    np.testing.assert_array_equal(encoder.frames[0], drawn)
    plain = Renderer([easy_world]).render(course.starts, time_s=course.clocks_s)
    assert (np.abs(drawn.astype(int) - plain)[..., :3].mean((1, 2, 3)) > 1.0).all()


@pytest.mark.slow
def test_for_an_encoder_of_masks_nothing_else_is_drawn(easy_world: World):
    course = Course.on(easy_world, CONFIG).varied(Randomisation.only(plant_density=(0.0, 0.5)), CONFIG)
    seeing, masked = RecordingEncoder(), RecordingEncoder("mask")
    for encoder in (seeing, masked):
        observe = encoded_frames(course, encoder)  # pyright: ignore[reportArgumentType]
        observe(Step(np.array([0, 2]), course.starts[[0, 2]], course.clocks_s[[0, 2]], np.zeros(2)))
    assert masked.frames[0].shape == (2, 128, 128, 1)
    np.testing.assert_array_equal(masked.frames[0], seeing.frames[0][..., 3:])
    assert 0 < masked.frames[0].mean() < 255


def test_only_the_named_parameter_varies_and_equally_for_every_policy(easy_world: World):
    course = Course.on(easy_world, CONFIG)
    varied = [course.varied(Randomisation.only(haze=(0.3, 6.0)), CONFIG) for _ in range(2)]
    first, second = (each.looks for each in varied)
    assert first is not None and second is not None
    np.testing.assert_array_equal(first, second)
    haze = PARAMETERS.index("haze")
    assert len(set(first[:, haze])) == 3 and (first[:, haze] >= 0.3).all() and (first[:, haze] <= 6.0).all()
    np.testing.assert_array_equal(np.delete(first, haze, 1), np.tile(np.delete(USUAL, haze), (3, 1)))
    np.testing.assert_array_equal(varied[0].starts, course.starts)
    assert varied[0].lights == ()


def test_a_single_start_of_a_varied_course_keeps_its_appearance(easy_world: World):
    course = Course.on(easy_world, CONFIG).varied(Randomisation.only(haze=(0.3, 6.0)), CONFIG)
    alone = course.only(2)
    assert course.looks is not None and alone.looks is not None
    np.testing.assert_array_equal(alone.looks, course.looks[2:])


def test_a_start_has_the_appearance_of_its_place_in_the_list_and_only_its_sun_is_baked(easy_world: World):
    ranges, course = (
        Randomisation.only(haze=(0.3, 6.0), sun_azimuth_deg=(0.0, 360.0), suns=3),
        Course.on(easy_world, CONFIG),
    )
    whole = course.varied(ranges, CONFIG)
    assert whole.looks is not None and whole.suns is not None
    assert {world.sun_azimuth for world in whole.lights} <= {angles[0] for angles in ranges.lights(easy_world.seed)}
    for index in range(3):
        one = course.only(index).varied(ranges, CONFIG)
        assert one.looks is not None and one.suns is not None and len(one.lights) == 1
        np.testing.assert_array_equal(one.looks[0], whole.looks[index])
        assert one.lights[one.suns[0]].sun_azimuth == whole.lights[whole.suns[index]].sun_azimuth
    assert len({*whole.looks[:, PARAMETERS.index("haze")]}) == 3


def test_each_parameter_of_the_appearance_has_a_condition_and_all_have_one_together():
    varied = [condition.varied for condition in CONDITIONS if condition.varied]
    assert {part for parts in varied[:-1] for part in parts} == {*PARAMETERS, *SUN}
    assert set(varied[-1]) == {*APPEARANCE, *SUN}
    assert SUITES["paper"].conditions == CONDITIONS


def test_trials_of_a_policy_and_of_a_baseline():
    suite = replace(
        SUITE, conditions=(Condition("mode", deterministic=True, blind=False), Condition("real", rivers=("Cam",)))
    )
    trained, baseline = (suite.trials(Run(kind, "PPO", 0)) for kind in ("train", "baseline"))
    main = ["Easy", "Medium", "Hard"]
    assert [str(trial) for trial in trained] == [*main, "Easy, mode", "Medium, mode", "Hard, mode", "Cam, real"]
    assert [str(trial) for trial in baseline] == [*main, "Cam, real"]


def test_each_condition_has_a_folder_in_the_results(tmp_path: Path):
    suite = replace(SUITE, conditions=(Condition("mode", ("Easy",), blind=False), Condition("real", rivers=("Cam",))))
    run_suite(suite, tmp_path, SmallBackend())
    path = evaluation_path(tmp_path, "PPO-1", Trial("Easy", suite.conditions[0]))
    assert path == tmp_path / "evaluation" / "mode" / "PPO-1-Easy.csv" and path.exists()
    results = read_results(tmp_path)
    assert {row.level for row in results.episodes} == {"Easy", "Medium", "Hard"}
    assert {row.algorithm for row in results.condition_episodes["mode"]} == {"PPO", "FOCOPS"}
    assert {(row.algorithm, row.level) for row in results.condition_episodes["real"]} == {
        ("hover", "Cam"), ("PPO", "Cam"), ("FOCOPS", "Cam"),
    }  # fmt: skip
    assert problems(results) == []
    path.unlink()
    (tmp_path / "evaluation" / "mode" / "notes.txt").write_text("mine")
    assert [line.split(":")[0] for line in problems(read_results(tmp_path))] == ["Not used", "Unfinished"]
    again = SmallBackend()
    run_suite(suite, tmp_path, again)
    assert again.calls == ["evaluate PPO-1 Easy, mode"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"levels": ("Esay",)},
            r"condition it: unknown level 'Esay' \(did you mean 'Easy'\?\); known: Easy, Medium, Hard",
        ),
        ({"rivers": ("Rhine",)}, "condition it: unknown river 'Rhine'; known: Cam"),
        ({"varied": ("fog",)}, "condition it: unknown range 'fog'.*; known: .*haze"),
        ({"name": "my/own"}, "a condition is called 'my/own'"),
        ({"name": ""}, "a condition is called ''"),
        ({"rivers": ("Cam",), "unseen": True}, "real rivers are neither levels nor unseen rivers"),
        ({"files": {"Isar": {"file": "no.kml"}}}, "condition it: 'Isar' has a file, but is not in its rivers"),
        ({"rivers": ("Isar",), "files": {"Isar": {"file": "no.kml"}}}, "river Isar: no.kml: there is no such file"),
        ({"rivers": ("Isar",), "files": {"Isar": {}}}, "river Isar: file must be the path of a file, not None"),
        ({"rivers": ("Isar",), "files": {"Isar": {"file": "x", "widht": 3}}}, "unknown option 'widht'; known: file, "),
        ({"rivers": ("Isar",), "files": {"Isar": {"file": "x", "start_m": "3"}}}, "start_m is '3'; expected a number"),
        ({"rivers": ("Cam",), "files": {"Cam": {"file": "x"}}}, "the name 'Cam' is that of another river"),
        ({"rivers": ("a b",), "files": {"a b": {"file": "x"}}}, "a river is called 'a b'"),
        ({"unseen": True, "varied": ("haze",)}, "the appearance can vary only on the levels' fixed rivers"),
    ],
)
def test_an_invalid_condition_is_refused_before_anything_runs(tmp_path: Path, changes: dict[str, Any], message: str):
    place = SmallBackend()
    with pytest.raises(ResultsError, match=message):
        run_suite(replace(SUITE, conditions=(Condition(**{"name": "it", **changes}),)), tmp_path / "new", place)
    assert place.calls == [] and not (tmp_path / "new").exists()


def test_two_conditions_with_the_same_name_are_refused(tmp_path: Path):
    with pytest.raises(ResultsError, match="condition it is named twice"):
        run_suite(replace(SUITE, conditions=(Condition("it"), Condition("it"))), tmp_path / "new", SmallBackend())


@pytest.mark.slow
def test_courses_follow_their_condition():
    rivers = RiverBackend(replace(SUITE, arms=(Arm("PPO"),), episodes=2))
    (main,) = rivers.courses(Trial("Easy", MAIN))
    (varied,) = rivers.courses(Trial("Easy", Condition("ripple", varied=("ripple",))))
    (real,) = rivers.courses(Trial("Cam", Condition("real", rivers=("Cam",))))
    unseen = rivers.courses(Trial("Easy", Condition("unseen", unseen=True)))
    np.testing.assert_array_equal(varied.starts, main.starts)
    assert varied.looks is not None and main.looks is None
    assert 290.0 < real.world.river.length_m < 310.0
    assert [(course.world.seed, len(course.starts)) for course in unseen] == [(100_000, 1), (100_001, 1)]
    assert rivers.config(Trial("Easy", Condition("mode", deterministic=True))).deterministic


def test_the_river_of_a_file_is_flown_under_its_own_name(tmp_path: Path):
    path = tmp_path / "brook.geojson"
    path.write_text('{"type": "LineString", "coordinates": [[9, 48], [9.0004, 48], [9.0008, 48], [9.0012, 48]]}')
    condition = Condition("mine", rivers=("brook",), files={"brook": {"file": str(path), "width_m": 9.0}})
    trial = Trial("brook", condition)
    suite = replace(SUITE, conditions=(condition,))
    assert trial in suite.trials(Run("baseline", "hover", 0))
    (course,) = RiverBackend(suite).courses(trial)
    assert (course.world.name, course.world.river.width_m[0]) == ("brook", 9.0)
    data = condition.as_data()
    assert "files" not in data
    assert data["rivers"]["brook"] == condition.river("brook").as_data()


def test_a_suite_takes_the_file_of_the_command_line_as_a_condition(tmp_path: Path):
    from thalweg.cli.bench import with_river
    from thalweg.world import Reach

    path = tmp_path / "my brook (2).geojson"
    path.write_text('{"type": "LineString", "coordinates": [[9, 48], [9.0004, 48], [9.0008, 48], [9.0012, 48]]}')
    reach = Reach(path, width_m=9.0, reverse=True)
    (condition,) = with_river(SUITE, reach).conditions
    assert (condition.name, condition.rivers) == ("river", ("my-brook-2",))
    assert condition.river("my-brook-2") == reach
