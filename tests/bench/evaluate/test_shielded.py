"""Shielded flights in the evaluation: what they are given, what is written, and who is refused."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from tests.bench.small_backend import SUITE
from tests.env import handmade
from tests.env.shield.channel import Channel, straight
from tests.image_policies import image_policy
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate import evaluation
from thalweg.bench.evaluate.baselines import BASELINES, Constant
from thalweg.bench.evaluate.conditions import CONDITIONS, MAIN, SHIELDED, Condition, Trial
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.episodes import COLUMNS, read_episodes, write_episodes
from thalweg.bench.evaluate.evaluation import Label, evaluate, image_frames, observation_function
from thalweg.bench.evaluate.shielded import FlightShield, Screening, check_masks
from thalweg.bench.execute.executors import is_evaluated
from thalweg.bench.results.results import Results, evaluation_path
from thalweg.bench.suite.arms import Arm, Run
from thalweg.bench.suite.config import Suite
from thalweg.core import versions
from thalweg.render import Camera
from thalweg.render.records.appearance import PARAMETERS, Look

CONFIG, LABEL = EvaluationConfig(episodes=3), Label("tester", 3, "Easy")
ASIDE = Constant((1, 1, 0, 0))
"""Flies forward and to the left."""


class ChannelRenderer:
    """Draws the masks of a straight canal, and nothing else."""

    camera = Camera()

    def __init__(self, half_width: float = 4.0) -> None:
        self.channel = Channel(straight(half_width))
        self.looks: list[np.ndarray] = []

    def render_tensors(self, views: Any, out: torch.Tensor) -> None:
        self.looks.append(views[3].numpy().copy())
        out.numpy()[...] = 0
        for index, pose in enumerate(views[1].numpy()):
            out.numpy()[index, ..., -1] = self.channel.mask(pose)


def course(**options: Any) -> Course:
    starts = np.array([[x, 0.0, 5.0, 0.0] for x in (2.0, 6.0, 10.0)])
    canal = handmade.canal(80.0, width_m=8.0, **options)
    return Course(canal, starts, np.zeros(3), np.arange(3))


def fly(policy: Any, flown: Course, shield: FlightShield | None = None, observation: str = "mask") -> list:
    renderer: Any = ChannelRenderer()
    observe = image_frames(flown, observation, renderer)
    return evaluate(policy, flown, LABEL, CONFIG, observe=observe, shield=shield)


def test_a_policy_that_leaves_the_river_stays_on_it_with_the_shield():
    without, shielded = fly(ASIDE, course()), fly(ASIDE, course(), FlightShield())
    assert [row.reason for row in without] == ["OutOfVolumeHorizontal"] * 3
    assert [row.reason for row in shielded] == ["Success"] * 3
    assert [(row.shield, row.vetoes) for row in without] == [(0, 0)] * 3
    assert all(row.shield == versions.SHIELD and row.vetoes > 10 for row in shielded)


def test_masks_of_a_policy_that_sees_nothing_are_drawn_in_the_chosen_quality(monkeypatch: pytest.MonkeyPatch):
    drawn: list[tuple[Any, ...]] = []
    monkeypatch.setattr(evaluation, "Renderer", lambda *given, **_: drawn.append(given[1:]) or ChannelRenderer())
    camera = Camera(pitch_deg=30.0)
    chosen: dict[str, Any] = {"quality": "fast", "camera": camera}
    observation_function(ASIDE, course(), None, shielded=True, **chosen)
    assert drawn == [(camera, "fast")]
    assert observation_function(ASIDE, course(), None, **chosen) is None and len(drawn) == 1


def test_a_shielded_flight_does_not_depend_on_the_others():
    together = fly(BASELINES["random"], course(), FlightShield())
    alone = [fly(BASELINES["random"], course().only(index), FlightShield())[0] for index in (2, 1, 0)]
    assert together == alone[::-1]


def test_a_flight_without_vetoes_is_the_same():
    without, shielded = (fly(BASELINES["forward"], course(), shield) for shield in (None, FlightShield()))
    assert [row.vetoes for row in shielded] == [0] * 3
    assert [replace(row, shield=0) for row in shielded] == without


def test_players_learn_what_they_did_and_say_how_probable_moves_are():
    policy, told = image_policy("mask", 128), []
    seen: list[bool] = []

    class Told:
        """The policy, whose players are kept."""

        about, shape = policy.about, policy.shape

        def player(self, *given: Any, **options: Any) -> Any:
            told.append(policy.player(*given, **options))
            return told[-1]

    def on_screen(screening: Screening) -> None:
        seen.append(bool(np.any(screening.made != screening.proposed)))
        for index, made in zip(screening.flying, screening.made, strict=True):
            assert (told[index]._rows.last[0] == made).all()

    fly(Told(), course(), FlightShield(on_screen=on_screen))
    assert any(seen)


def test_the_shield_knows_the_pitch_and_field_of_view_of_each_flight():
    looks = np.array([[getattr(Look(), name) for name in PARAMETERS]] * 3)
    looks[1, PARAMETERS.index("pitch_deg")], looks[2, PARAMETERS.index("fov_deg")] = 5.0, -6.0
    shield = FlightShield()
    fly(ASIDE, replace(course(), looks=looks), shield)
    optics = shield.optics
    assert np.allclose(np.degrees(optics.pitch), [20.0, 25.0, 20.0], atol=1e-4)
    assert np.allclose(np.degrees(2 * np.arctan(optics.half_height)), [60.0, 60.0, 54.0], atol=1e-4)


def test_files_say_which_flights_were_shielded(tmp_path: Path):
    shielded, without = fly(ASIDE, course(), FlightShield()), fly(ASIDE, course())
    write_episodes(tmp_path / "with.csv", shielded)
    write_episodes(tmp_path / "without.csv", without)
    assert read_episodes(tmp_path / "with.csv") == shielded
    assert read_episodes(tmp_path / "without.csv") == without
    headings = [(tmp_path / f"{name}.csv").read_text().split("\n")[0].split(",") for name in ("with", "without")]
    assert [set(heading) - {"ahead"} for heading in headings] == [{*COLUMNS, "shield", "vetoes"}, {*COLUMNS}]


def policy_of(observation: str) -> Any:
    return SimpleNamespace(about=SimpleNamespace(context={"observation": observation}))


def test_policies_without_masks_are_refused():
    for policy in (policy_of("privileged"), image_policy("rgb")):
        with pytest.raises(ResultsError, match="the shield reads water masks, but this policy sees"):
            check_masks(policy)
    with pytest.raises(ResultsError, match=r"the encoder of this policy sees none \(rgb\)"):
        check_masks(policy_of("frames"), SimpleNamespace(inputs="rgb"))
    with pytest.raises(ResultsError, match="give the `observe` that observation_function"):
        evaluate(ASIDE, course(), LABEL, CONFIG, observe=lambda step: step.poses, shield=FlightShield())
    with pytest.raises(ResultsError, match="give the `observe`"):
        evaluate(ASIDE, course(), LABEL, CONFIG, shield=FlightShield())
    for policy in (policy_of("frames"), image_policy("mask"), image_policy("rgb+mask"), BASELINES["random"]):
        check_masks(policy)


def test_the_condition_is_off_unless_it_is_named():
    assert SHIELDED not in CONDITIONS
    assert "shield" not in MAIN.as_data() and SHIELDED.as_data()["shield"] is True
    assert Condition("mine", shield=True).as_data() != Condition("mine").as_data()


def test_policies_of_the_privileged_observation_are_not_flown_under_it():
    suite = Suite("mine", (Arm("PPO"), Arm("CUP", observation="privileged")), conditions=(SHIELDED,))
    names = {run: {trial.condition.name for trial in suite.trials(suite_run(suite, run))} for run in ("PPO", "CUP")}
    assert names == {"PPO": {"", "shield"}, "CUP": {""}}


def test_only_policies_that_see_water_are_planned_to_fly_under_a_shield():
    own = Condition("mine", shield=True)
    arms = (Arm("PPO", seeds=(0,)), Arm("CUP", seeds=(0,), observation="privileged"))
    suite = Suite("it", arms, conditions=(own, Condition("usual")), baselines=("hover",), packaged=False)
    planned = Results(Path(), suite.as_data(), [], [], [], []).planned_flights
    flown = {(trial.condition.name, run.algorithm) for run in suite.runs() for trial in suite.trials(run)}
    assert {flight[:2] for flight in planned} == flown
    assert {policy for condition, policy in flown if condition == "mine"} == {"PPO"}


def suite_run(suite: Suite, algorithm: str) -> Run:
    return next(run for run in suite.runs() if run.kind == "train" and run.algorithm.startswith(algorithm))


def test_flights_with_an_older_shield_are_flown_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    run, trial = suite_run(SUITE, "PPO"), Trial("Easy", SHIELDED)
    path = evaluation_path(tmp_path, run.name, trial)
    path.parent.mkdir(parents=True)
    write_episodes(path, fly(ASIDE, course(), FlightShield()))
    assert is_evaluated(tmp_path, run, trial, 3)
    monkeypatch.setattr(versions, "SHIELD", versions.SHIELD + 1)
    assert not is_evaluated(tmp_path, run, trial, 3)
