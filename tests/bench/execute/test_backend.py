"""The real place of a suite, with its course exchanged for one made by hand."""

import pickle
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import MultiDiscrete

from tests.env import handmade
from tests.image_policies import image_policy
from thalweg.algos import Policy
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.policy_file import About
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate import evaluation
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.evaluate.conditions import Condition, Trial
from thalweg.bench.evaluate.course import Course
from thalweg.bench.execute import backend
from thalweg.bench.execute.backend import RiverBackend, installed_versions
from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.bench.pictures import film
from thalweg.bench.pictures.film_format import SMALL
from thalweg.bench.results.run_versions import STEADY, current_versions
from thalweg.bench.suite.arms import Arm, Run, Stage
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.policy_files import PolicyFile
from thalweg.core import versions
from thalweg.core.plugins.record import RESERVED
from thalweg.core.seeds import UNSEEN
from thalweg.env import sample_starts
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.render import Camera
from thalweg.train.errors import TrainingError
from thalweg.train.folder.run_record import POLICY
from thalweg.train.river import RiverTraining
from thalweg.world import World

SUITE = Suite(
    "tiny", (Arm("PPO", seeds=(0,), steps=512),), train_level="Easy", test_levels=("Easy",), episodes=4, packaged=False
)
RUN = Run("baseline", "random", 0)
RUN_OF_PPO = Run("train", "PPO", 0)
LEVELS = ("Easy", "Medium")


@pytest.fixture
def rivers(monkeypatch: pytest.MonkeyPatch) -> RiverBackend:
    ring = handmade.ring()
    course = Course(ring, sample_starts(ring, 4, 0), np.zeros(4), np.arange(4))
    monkeypatch.setattr(Course, "of_level", classmethod(lambda *_, drawn=True: course))
    return RiverBackend(SUITE)


def test_only_rivers_whose_frames_are_seen_have_land(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    ring, asked = handmade.ring(), []
    course = Course(ring, sample_starts(ring, 4, 0), np.zeros(4), np.arange(4))
    monkeypatch.setattr(Course, "of_level", classmethod(lambda *_, drawn: asked.append(drawn) or course))
    place = RiverBackend(SUITE)
    monkeypatch.setattr(place, "observer", lambda *_: lambda step: np.zeros((len(step.flying), 4), np.float32))
    for policy in (BASELINES["hover"], BASELINES["pilot"], Policy(4, actions_of(MultiDiscrete([3, 3, 3, 3])))):
        monkeypatch.setattr(place, "policy", lambda *_, given=policy: given)
        place.evaluate(RUN, tmp_path, Trial("Easy"), lambda _: None)
    monkeypatch.setattr(place, "policy", lambda *_: image_policy("mask"))
    monkeypatch.setattr(place, "observer", lambda *_: lambda step: np.zeros((len(step.flying), 128, 128, 1), np.uint8))
    place.evaluate(RUN, tmp_path, Trial("Easy"), lambda _: None)
    assert asked == [False, False, True, True]


def test_the_film_shows_the_very_flight_of_its_row(
    rivers: RiverBackend, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    filmed: list[Any] = []
    monkeypatch.setattr(film, "write_film", lambda path, world, flight, title, **_: filmed.append(flight))
    row = rivers.evaluate(RUN, tmp_path, Trial("Easy"), lambda _: None)[2]
    rivers.film(RUN, tmp_path, row, tmp_path / "film.mp4", lambda: None, shape=SMALL)
    (flight,) = filmed
    assert flight.episode == row
    assert len(flight.poses) == row.length
    np.testing.assert_array_equal(flight.poses[0], [row.x, row.y, row.z, row.yaw])


@pytest.mark.parametrize(("field", "value"), [("return_", 9.75), ("length", 499), ("reason", "Success"), ("x", 1.0)])
def test_a_flight_that_ends_otherwise_than_its_row_is_not_filmed(
    rivers: RiverBackend, tmp_path: Path, field: str, value: Any
):
    row = rivers.evaluate(RUN, tmp_path, Trial("Easy"), lambda _: None)[1]
    other = replace(row, **{field: value})
    with pytest.raises(ResultsError, match=f"{field.rstrip('_')} .*{value!r} in the results"):
        rivers.film(RUN, tmp_path, other, tmp_path / "film.mp4", lambda: None, shape=SMALL)
    assert list(tmp_path.iterdir()) == []


def test_stages_are_trained_in_order_each_beginning_as_the_one_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    told: list[tuple[Any, ...]] = []

    def train(ground: RiverTraining, algorithm: str, encoder: Any, **options: Any) -> None:
        told.append(
            (ground.river, algorithm, options["steps"], options["seed"], options["folder"], options["begin_with"])
        )

    monkeypatch.setattr(RiverTraining, "train", train)
    monkeypatch.setattr(backend, "load_compatible_encoder", lambda _: None)
    before = (Stage("PPO", "Easy", 100), Stage("FOCOPS", "Medium", 20_000, settings={"cost_limit": 0.3}))
    arm = Arm("FOCOPS", seeds=(4,), steps=30_000, level="Hard", before=before, name="curriculum")
    home = tmp_path / "curriculum-4"
    RiverBackend(replace(SUITE, arms=(arm,))).train(Run("train", "curriculum", 4), home)
    first, second = home / ".before" / "0", home / ".before" / "1"
    assert told == [
        ("Easy", "PPO", 100, 4, first, None),
        ("Medium", "FOCOPS", 20_000, 4, second, first),
        ("Hard", "FOCOPS", 30_000, 4, home, second),
    ]


def test_a_stage_without_a_level_is_trained_on_that_of_the_suite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    levels: list[Any] = []
    monkeypatch.setattr(RiverTraining, "train", lambda ground, *_, **__: levels.append(ground.river))
    monkeypatch.setattr(backend, "load_compatible_encoder", lambda _: None)
    arm = Arm("PPO", before=(Stage("PPO", "", 1),), level="Easy", name="begun")
    RiverBackend(replace(SUITE, arms=(arm,), train_level="Hard")).train(Run("train", "begun", 0), tmp_path)
    assert levels == ["Hard", "Easy"]


def test_each_stage_is_trained_on_its_own_rivers_or_those_of_its_arm_or_suite(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    given: list[Any] = []
    monkeypatch.setattr(RiverTraining, "train", lambda ground, *_, **__: given.append((ground.river, ground.seeds)))
    monkeypatch.setattr(backend, "load_compatible_encoder", lambda _: "the encoder")
    stages = (Stage("PPO", "Easy", 1, world_seeds="3:6"), Stage("PPO", "Hard", 20_000))  # pyright: ignore[reportArgumentType]
    arms = (Arm("PPO", before=stages, world_seeds=[8, "10:12"], name="own"), Arm("CUP"))  # pyright: ignore
    place = RiverBackend(replace(SUITE, arms=arms, world_seeds="1000:1003", train_level="Medium"))
    for label in ("own", "CUP"):
        place.train(Run("train", label, 0), tmp_path)
    assert given == [
        ("Easy", (3, 4, 5)),
        ("Hard", (8, 10, 11)),
        ("Medium", (8, 10, 11)),
        ("Medium", (1000, 1001, 1002)),
    ]


def test_an_arm_sees_frames_or_the_privileged_observation_in_all_its_stages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    given: list[Any] = []
    monkeypatch.setattr(RiverTraining, "train", lambda _, algorithm, encoder, **__: given.append((algorithm, encoder)))
    monkeypatch.setattr(backend, "load_compatible_encoder", lambda _: "the encoder")
    arms = (Arm("PPO", before=(Stage("P3O", "Easy", 1),)), Arm("CUP", observation="privileged"))
    place = RiverBackend(replace(SUITE, arms=arms))
    for label in ("PPO", "CUP-privileged"):
        place.train(Run("train", label, 0), tmp_path)
    assert given == [("P3O", "the encoder"), ("PPO", "the encoder"), ("CUP", None)]


def test_an_arm_of_images_sees_them_without_an_encoder_and_may_begin_with_the_packaged_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    given: list[tuple[Any, ...]] = []

    def train(_: RiverTraining, algorithm: str, encoder: Any, **options: Any) -> None:
        given.append((algorithm, encoder, options["observation"], options["begin_with"]))

    monkeypatch.setattr(RiverTraining, "train", train)
    seen: dict[str, Any] = {"settings": {"policy": "cnn"}, "observation": "rgb+mask"}
    begun = Arm(
        "CPO",
        name="begun",
        begin_with=PolicyFile.of("packaged"),
        before=(Stage("PPO", "Easy", 50_000, settings={"policy": "cnn"}),),
        **seen,
    )
    suite = Suite("mine", (Arm("PPO", name="PPO", **seen), begun), baselines=(), packaged=False)
    for name in ("PPO", "begun"):
        RiverBackend(suite).train(Run("train", name, 0), tmp_path)
    assert given == [
        ("PPO", None, "rgb+mask", None),
        ("PPO", None, "rgb+mask", PACKAGED_POLICY),
        ("CPO", None, "rgb+mask", tmp_path / ".before" / "0"),
    ]


def test_an_arm_sees_the_codes_of_its_own_encoder_or_of_the_suites_each_loaded_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    given, loaded = [], []
    monkeypatch.setattr(RiverTraining, "train", lambda _, algorithm, encoder, **__: given.append((algorithm, encoder)))
    monkeypatch.setattr(backend, "load_compatible_encoder", lambda name: loaded.append(name) or f"the {name} encoder")
    arms = (Arm("PPO", before=(Stage("P3O", "Easy", 1),)), Arm("CUP", encoder="geometry"))
    for suite in (replace(SUITE, arms=arms), replace(SUITE, arms=arms[:1], encoder="geometry")):
        place = RiverBackend(suite)
        for arm in suite.arms:
            place.train(Run("train", arm.label, 0), tmp_path)
    ours, theirs = "the default encoder", "the geometry encoder"
    assert given == [("P3O", ours), ("PPO", ours), ("CUP", theirs), ("P3O", theirs), ("PPO", theirs)]
    assert loaded == ["default", "geometry", "geometry"]


def test_a_place_that_has_loaded_encoders_and_drawn_rivers_travels_without_them():
    place = RiverBackend(SUITE)
    place.encoder(RUN_OF_PPO)
    place._observers["Easy", "frames", Camera(), "default"] = None
    travelled = pickle.loads(pickle.dumps(place))
    assert vars(travelled) == vars(RiverBackend(SUITE))


def test_a_policy_of_the_privileged_observation_is_flown_and_filmed_without_an_encoder(
    rivers: RiverBackend, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def loaded(_: str) -> None:
        raise AssertionError("an encoder was loaded")

    filmed: list[Any] = []
    monkeypatch.setattr(backend, "load_compatible_encoder", loaded)
    monkeypatch.setattr(film, "write_film", lambda path, world, flight, title, **_: filmed.append((flight, title)))
    about = About("PPO", {}, {"observation": "privileged", "privileged_version": versions.PRIVILEGED})
    Policy(len(FEATURES), actions_of(MultiDiscrete([3, 3, 3, 3])), about=about).save(tmp_path / POLICY)
    run, trial = Run("train", "PPO", 0), Trial("Easy")
    row = rivers.evaluate(run, tmp_path, trial, lambda _: None)[2]
    rivers.film(run, tmp_path, row, tmp_path / "film.mp4", lambda: None, shape=SMALL)
    ((flight, title),) = filmed
    assert (flight.episode, title, len(flight.poses)) == (row, "PPO, seed 0", row.length)


class Drawn(handmade.BlankRenderer):
    """A renderer that writes down the channels and the haze of what it draws."""

    def __init__(self) -> None:
        super().__init__()
        self.camera = Camera()
        self.channels: set[int] = set()
        self.looks: set[tuple[float, ...]] = set()

    def render_tensors(self, views: Any, out: Any) -> None:
        self.channels.add(out.shape[-1])
        self.looks |= {tuple(look) for look in views[3].tolist()}
        super().render_tensors(views, out)


@pytest.fixture
def renderers(rivers: RiverBackend, monkeypatch: pytest.MonkeyPatch) -> list[Drawn]:
    """The renderers that a backend makes, which needs no encoder for policies of images."""
    made: list[Drawn] = []

    def loaded(_: str) -> None:
        raise AssertionError("an encoder was loaded")

    monkeypatch.setattr(backend, "load_compatible_encoder", loaded)
    monkeypatch.setattr(evaluation, "Renderer", lambda *_, **__: made.append(Drawn()) or made[-1])
    return made


def test_a_policy_of_images_is_flown_and_filmed_without_an_encoder(
    rivers: RiverBackend, renderers: list[Drawn], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    filmed: list[Any] = []
    monkeypatch.setattr(film, "write_film", lambda path, world, flight, title, **_: filmed.append(flight))
    image_policy("mask").save(tmp_path / POLICY)
    run = Run("train", "PPO", 0)
    row = rivers.evaluate(run, tmp_path, Trial("Easy"), lambda _: None)[2]
    rivers.film(run, tmp_path, row, tmp_path / "film.mp4", lambda: None, shape=SMALL)
    assert [flight.episode for flight in filmed] == [row]
    assert [renderer.channels for renderer in renderers] == [{1}]  # the film needs no second one


def test_policies_of_different_images_do_not_share_a_view(rivers: RiverBackend, renderers: list[Drawn], tmp_path: Path):
    for images in ("mask", "rgb", "rgb+mask", "mask"):
        image_policy(images).save(tmp_path / POLICY)
        rivers.evaluate(Run("train", "PPO", 0), tmp_path, Trial("Easy"), lambda _: None)
    assert [renderer.channels for renderer in renderers] == [{1}, {4}, {4}]


def test_each_level_has_a_view_of_its_own_world_which_later_runs_share(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    levels = {level: SimpleNamespace(world=f"the world of {level}", starts=np.zeros((1, 4))) for level in LEVELS}
    viewed, flown = [], []
    monkeypatch.setattr(Course, "of_level", classmethod(lambda _, level, *__, **___: levels[level]))
    monkeypatch.setattr(backend, "observation_function", lambda _, world, *__: viewed.append(world) or world)
    monkeypatch.setattr(backend, "evaluate", lambda *_, observe, **__: flown.append(observe) or [])
    image_policy("mask").save(tmp_path / POLICY)
    place = RiverBackend(replace(SUITE, test_levels=LEVELS))
    for level in ("Easy", "Medium", "Easy"):
        place.evaluate(RUN_OF_PPO, tmp_path, Trial(level), lambda _: None)
    assert viewed == ["the world of Easy", "the world of Medium"]
    assert flown == ["the world of Easy", "the world of Medium", "the world of Easy"]


def test_each_encoder_has_a_view_of_its_own(monkeypatch: pytest.MonkeyPatch):
    arms = (Arm("PPO"), Arm("CUP", encoder="geometry"))
    course: Any = SimpleNamespace(world="the world")
    monkeypatch.setattr(backend, "load_compatible_encoder", lambda name: name)
    monkeypatch.setattr(backend, "check_policy_fits", lambda *_, **__: None)
    monkeypatch.setattr(backend, "observation_function", lambda _, __, encoder: f"codes of {encoder}")
    place, policy = RiverBackend(replace(SUITE, arms=arms)), Policy(4, actions_of(MultiDiscrete([3, 3, 3, 3])))
    seen = [place.observer(Run("train", arms[at].label, 0), Trial("Easy"), course, policy) for at in (0, 1, 0)]
    assert seen == ["codes of default", "codes of geometry", "codes of default"]


def test_a_policy_of_images_sees_the_appearance_of_each_start(
    rivers: RiverBackend, renderers: list[Drawn], tmp_path: Path
):
    image_policy("rgb").save(tmp_path / POLICY)
    trial = Trial("Easy", Condition("haze", varied=("haze",)))
    rows = rivers.evaluate(Run("train", "PPO", 0), tmp_path, trial, lambda _: None)
    assert len(rows) == len(renderers[0].looks) == 4


def test_a_policy_of_images_of_another_renderer_is_not_flown(rivers: RiverBackend, tmp_path: Path):
    image_policy(render_version=versions.RENDER + 1).save(tmp_path / POLICY)
    with pytest.raises(TrainingError, match=f"images of renderer version {versions.RENDER + 1}, but the renderer is"):
        rivers.evaluate(Run("train", "PPO", 0), tmp_path, Trial("Easy"), lambda _: None)


def test_unseen_rivers_are_built_seen_and_flown_one_after_the_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    told: list[tuple[str, int]] = []
    waiting: list[int] = []

    def built(level: Any, seed: int, *_: Any) -> World:
        told.append(("built", seed - UNSEEN))
        return replace(handmade.canal(length_m=60.0), seed=seed)

    def flown(policy: Any, course: Any, *_: Any, on_step: Any, **__: Any) -> list[Any]:
        told.append(("flown", course.world.seed - UNSEEN))
        on_step(SimpleNamespace(waiting=0))
        return []

    place = RiverBackend(Suite("mine", (), packaged=False, episodes=3))
    monkeypatch.setattr("thalweg.bench.evaluate.course.load_or_plan", built)
    monkeypatch.setattr(backend, "evaluate", flown)
    monkeypatch.setattr(backend, "replace", lambda step, waiting: waiting)
    monkeypatch.setattr(
        backend, "observation_function", lambda _, course, *__, **___: told.append(("seen", course.world.seed - UNSEEN))
    )
    trial = Trial("Easy", Condition("away", unseen=True))
    place.evaluate(Run("baseline", "hover", 0), tmp_path, trial, waiting.append)  # pyright: ignore[reportArgumentType]
    assert told == [(what, number) for number in range(3) for what in ("built", "seen", "flown")]
    assert waiting == [2, 1, 0]


@pytest.mark.parametrize("shield", [True, False])
def test_the_shield_reads_masks_through_the_camera_of_the_policy(
    shield: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    camera = {"height_px": 32, "width_px": 32, "fov_deg": 80.0, "pitch_deg": 5.0}
    policy, given = image_policy("rgb+mask", 32, env={"camera": camera}), []
    flown = RiverBackend(Suite("mine", (Arm("PPO"),), packaged=False))
    course = SimpleNamespace(starts=np.zeros((1, 4)))
    monkeypatch.setattr(flown, "policy", lambda *_: policy)
    monkeypatch.setattr(flown, "courses", lambda *_, **__: [course])
    monkeypatch.setattr(flown, "observer", lambda *_: None)
    monkeypatch.setattr(backend, "evaluate", lambda *arguments, **_: given.append(arguments[3].env.camera) or [])
    flown.evaluate(Run("train", "PPO", 0), tmp_path, Trial("Easy", Condition("kept", shield=shield)), lambda _: None)
    assert given == [Camera(**camera) if shield else Camera()]


def test_no_plugin_has_the_name_of_a_version_that_results_record():
    recorded = {name for name in installed_versions() if name.isidentifier() and name[0].islower()}
    assert {"banks", "world"} <= recorded <= {*RESERVED}


def test_machines_compare_every_version_that_results_record():
    recorded = current_versions(
        "train",
        ["PPO"],
        observation="frames",
        asymmetric_critics=True,
        told_cost_critics=True,
        begins_with_packaged=True,
        task="Swimmers",
        forces=True,
        banks=True,
    )
    assert {*recorded, *current_versions("baseline", [STEADY])} <= {*installed_versions()}


def test_stages_are_trained_with_their_presets_and_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    told: list[Any] = []

    def train(ground: RiverTraining, algorithm: str, encoder: Any, **options: Any) -> None:
        told.append((ground.num_envs, options["preset"], options["settings"]))

    monkeypatch.setattr(RiverTraining, "train", train)
    monkeypatch.setattr(backend, "load_compatible_encoder", lambda _: None)
    before = (Stage("FOCOPS", "Easy", 20_000, "paper", settings={"cost_limit": 0.3}),)
    suite = Suite("tiny", (Arm("FOCOPS", "paper", before=before, name="two"),), num_envs=8)
    RiverBackend(suite).train(Run("train", "two", 0), tmp_path)
    assert told == [(8, "paper", {"cost_limit": 0.3}), (8, "paper", None)]
