"""Tests of suites whose policies see other cameras, looks and qualities in training, and of their actions."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.env import handmade
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import Trial
from thalweg.bench.evaluate.course import Course
from thalweg.bench.execute import backend
from thalweg.bench.execute.backend import RiverBackend
from thalweg.bench.execute.runner import claim
from thalweg.bench.suite.arms import Arm, Run
from thalweg.bench.suite.builtin import load_suite
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.flown import Function
from thalweg.bench.suite.policy_files import PolicyFile
from thalweg.bench.suite.record import read_suite, rules_in_words
from thalweg.bench.suite.views import TrainingViews
from thalweg.cli.bench import Rules
from thalweg.cli.views import TrainedViews
from thalweg.core.config import parse_config
from thalweg.env import EnvConfig, sample_starts
from thalweg.render import Camera, Randomisation
from thalweg.render.optics.lens import Lens

OWN = Suite("own", (Arm("PPO"),), packaged=False)
WIDE = """
name: wide
arms: [{algorithm: PPO}]
packaged: false
views: {camera: {fov_deg: 75}, quality: fast, randomise: true}
"""


def test_a_file_says_what_is_seen_in_training_and_flights_are_drawn_as_ever(tmp_path: Path):
    (tmp_path / "wide.yaml").write_text(WIDE)
    suite = load_suite(str(tmp_path / "wide.yaml"))
    assert suite.views == TrainingViews(Camera(fov_deg=75.0), "fast", True)
    learnt = EnvConfig(camera=Camera(fov_deg=75.0), quality="fast", randomisation=True)  # pyright: ignore
    assert suite.training_rules == learnt and learnt.randomisation == Randomisation()
    assert RiverBackend(suite).config(suite.trials(suite.runs()[0])[0]).env == EnvConfig(observation="none")
    claim(tmp_path / "results", suite)
    record = read_suite(tmp_path / "results")
    assert record["views"]["quality"] == "fast"
    assert rules_in_words(record) == (
        "Policies were trained with a camera of 128 x 128 pixels, a field of view of 75 degrees and a pitch of 20,"
        " varied looks, fast frames."
    )
    claim(tmp_path / "results", suite)  # which is resumed
    with pytest.raises(ResultsError, match="views"):
        claim(tmp_path / "results", OWN)


def test_a_camera_whose_frames_do_not_fit_the_encoder_is_refused_when_the_suite_is_read(tmp_path: Path):
    (tmp_path / "wide.yaml").write_text(WIDE.replace("fov_deg: 75", "height_px: 96, width_px: 160"))
    told = (
        r"suite wide: PPO: the camera draws frames of 96 x 160 pixels \(height x width\), but the encoder default takes"
        " 128 x 128: give the camera height_px=128 and width_px=128"
    )
    with pytest.raises(ResultsError, match=told):
        load_suite(str(tmp_path / "wide.yaml"))
    wide = TrainingViews(Camera(96, 160))
    with pytest.raises(ResultsError, match=r"Mine: the camera draws .* the encoder geometry takes 128 x 128"):
        replace(OWN, arms=(Arm("PPO", name="Mine", encoder="geometry"),), views=wide)
    images = Arm("PPO", settings={"policy": "cnn"}, observation="rgb")
    assert replace(OWN, arms=(images,), views=wide).views.camera == Camera(96, 160)


def test_the_lens_of_a_suite_is_read_back_and_named():
    suite = replace(OWN, views=TrainingViews(Camera(lens=Lens("plumb_bob", (-0.2, 0.04)))))
    data = suite.as_data()
    assert data["views"]["camera"]["lens"]["coefficients"] == [-0.2, 0.04]
    assert parse_config(TrainingViews, data["views"]) == suite.views
    assert "a field of view of 60 degrees and a pitch of 20 behind a plumb_bob lens." in rules_in_words(data)


def test_suites_of_the_levels_views_are_written_as_before():
    assert "views" not in OWN.as_data() and rules_in_words(OWN.as_data()) == ""
    assert OWN.training_rules == OWN.rules == EnvConfig()


def test_continuous_actions_are_those_of_training_and_flights():
    suite = replace(OWN, views=TrainingViews(action="continuous"))
    assert suite.rules.action == suite.training_rules.action == "continuous"
    with pytest.raises(ResultsError, match="the packaged policy has no continuous actions"):
        replace(suite, packaged=True)
    begun = Arm(
        "PPO", settings={"policy": "cnn"}, observation="rgb+mask", begin_with=PolicyFile.of("packaged"), name="begun"
    )
    assert replace(OWN, arms=(begun,)).arms == (begun,)
    with pytest.raises(ResultsError, match="arm begun: the policy packaged has no continuous actions"):
        replace(suite, arms=(begun,))


def test_functions_that_choose_options_fly_by_continuous_actions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "mine.py").write_text("def ahead(obs):\n    return [1, 1, 0, 1]\nahead.observation = 'privileged'\n")
    views = TrainingViews(action="continuous")
    suite = replace(OWN, policies=(Function(f"{tmp_path / 'mine.py'}:ahead"),), views=views, episodes=2)
    ring = handmade.ring()
    course = Course(ring, sample_starts(ring, 2, 0), np.zeros(2), np.arange(2))
    monkeypatch.setattr(Course, "of_level", classmethod(lambda *_, drawn=True: course))
    rows = RiverBackend(suite).evaluate(Run("function", "ahead", 0), tmp_path, Trial("Medium"), lambda _: None)
    assert [row.length > 1 for row in rows] == [True, True]


def test_settings_of_frames_are_refused_where_nothing_is_drawn():
    views = TrainingViews(Camera(fov_deg=75.0), randomise=True)
    with pytest.raises(ResultsError, match="nothing is drawn: leave camera and randomise of the views out"):
        replace(OWN, observation="privileged", views=views)
    arms = (Arm("PPO", observation="privileged"), Arm("FOCOPS"))
    assert replace(OWN, arms=arms, views=views).views == views  # one of them sees frames


def test_policies_are_trained_with_what_the_suite_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    suite = replace(OWN, observation="privileged", views=TrainingViews(action="continuous"))
    trained: list[Any] = []

    class Training:
        def __init__(self, *given: Any) -> None:
            trained.append(given[-1])

        def train(self, *_: Any, **__: Any) -> None: ...

    monkeypatch.setattr(backend, "RiverTraining", Training)
    run = next(run for run in suite.runs() if run.kind == "train")
    RiverBackend(suite).train(run, tmp_path)
    assert trained == [suite.training_rules]


def test_options_of_the_command_replace_what_they_name():
    suite = replace(OWN, views=TrainingViews(quality="fast", action="continuous"))
    asked = Rules(views=TrainedViews(camera=("pitch_deg=30",), randomise=True)).of(suite)
    assert asked.views == TrainingViews(Camera(pitch_deg=30.0), "fast", True, "continuous")
    assert Rules().of(suite) == suite
