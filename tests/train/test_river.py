"""Tests of training on rivers: which policies, encoders and worlds fit one another."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import pytest
import torch
import yaml

from tests.env.handmade import BlankRenderer, ring
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.policy import Policy
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, evaluate
from thalweg.encoder import VAE, Encoder, EncoderFileError, EncoderInputError, VAEConfig, load_encoder, save_vae
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.config import ConfigError
from thalweg.render import RENDER_VERSION, Camera, compilation
from thalweg.train import river, run
from thalweg.train.errors import TrainingError
from thalweg.train.observations import check_policy_fits, encoder_hash
from thalweg.train.river import RiverTraining, load_compatible_encoder
from thalweg.world import LEVELS, Reach


def encoder_file(path: Path, seed: int, version: int = RENDER_VERSION) -> Path:
    torch.manual_seed(seed)
    save_vae(path, VAE(VAEConfig()), {"render_version": version})
    return path


def test_a_policy_flies_only_through_the_encoder_it_was_trained_with(tmp_path: Path):
    own, other = (load_encoder(encoder_file(tmp_path / f"{seed}.safetensors", seed)) for seed in (0, 1))
    policy: Any = SimpleNamespace(about=SimpleNamespace(context={"encoder": encoder_hash(own)}))
    check_policy_fits(policy, own)
    message = (
        rf"of an encoder of its own \(its hash: {encoder_hash(own)}\), but {tmp_path / '1.safetensors'} is another"
        rf" encoder \(its hash: {encoder_hash(other)}\); use the one that it was trained with$"
    )
    with pytest.raises(TrainingError, match=message):
        check_policy_fits(policy, other)


def test_a_policy_without_an_encoder_hash_is_accepted(tmp_path: Path):
    encoder = load_encoder(encoder_file(tmp_path / "0.safetensors", 0))
    check_policy_fits(BASELINES["hover"], encoder)


def test_an_encoder_of_another_renderer_is_refused(tmp_path: Path):
    path = encoder_file(tmp_path / "old.safetensors", 0, version=RENDER_VERSION + 1)
    with pytest.raises((EncoderFileError, EncoderInputError), match=str(RENDER_VERSION + 1)):
        load_compatible_encoder(path)


@pytest.mark.parametrize(
    ("obs_size", "space", "message"),
    [
        (8, gym.spaces.MultiDiscrete([3, 3, 3, 3]), "the policy takes 8 numbers, but the encoder returns 16"),
        (16, gym.spaces.MultiDiscrete([3, 3, 3]), r"counted from 0, not \(3, 3, 3\)"),
        (16, gym.spaces.MultiDiscrete([3, 3, 3, 2]), r"counted from 0, not \(3, 3, 3, 2\)"),
        (
            16,
            gym.spaces.MultiDiscrete([3, 3, 3, 3], start=[1, 1, 1, 1]),
            r"counted from 0, not \(3, 3, 3, 3\) from \(1, 1, 1, 1\)",
        ),
        (16, gym.spaces.Box(-1, 1, (4,)), r"counted from 0, not a Box of shape \(4,\)"),
        (16, gym.spaces.Discrete(81), r"counted from 0, not \(81,\)"),
    ],
)
def test_a_policy_that_does_not_fit_the_river_is_refused(tmp_path: Path, obs_size: int, space: gym.Space, message: str):
    encoder = load_encoder(encoder_file(tmp_path / "0.safetensors", 0))
    with pytest.raises(TrainingError, match=message):
        check_policy_fits(Policy(obs_size, actions_of(space)), encoder)


@pytest.mark.parametrize("adapter", ["native", "box_literal", "box_scaled"])
def test_a_policy_of_the_rivers_own_spaces_fits(tmp_path: Path, adapter: Any):
    encoder = load_encoder(encoder_file(tmp_path / "0.safetensors", 0))
    check_policy_fits(Policy(16, actions_of(gym.spaces.MultiDiscrete([3, 3, 3, 3]), adapter)), encoder)


LINE = '{"type": "LineString", "coordinates": [[9, 48], [9.0004, 48], [9.0008, 48], [9.0012, 48]]}'


@pytest.fixture
def brook(tmp_path: Path) -> Reach:
    (tmp_path / "brook.geojson").write_text(LINE)
    return Reach(tmp_path / "brook.geojson", width_m=6.0)


class BlankEnv(RiverVectorEnv):
    """Draws nothing, which takes no time."""

    def __init__(self, worlds: Any, num_envs: int, config: EnvConfig) -> None:
        super().__init__(worlds, num_envs, config, renderer=BlankRenderer(128, 128))


class Stop(Exception):
    pass


def brook_run(where: RiverTraining, encoder: Any, folder: Path, steps: int = 96) -> Any:
    settings = {"steps_per_update": 32, "minibatch": 16, "passes": 1, "hidden": [8]}
    return where.train("PPO", encoder, steps=steps, seed=1, folder=folder, settings=settings)


@pytest.mark.slow
def test_a_run_on_a_real_river_resumes_to_the_same_policy_and_names_its_file(
    tmp_path: Path, brook: Reach, monkeypatch: pytest.MonkeyPatch
):
    encoder = load_encoder(encoder_file(tmp_path / "0.safetensors", 0))

    class Breaks(BlankEnv):
        steps = 0

        def step(self, actions: Any) -> Any:
            self.steps += 1
            if self.steps == 40:
                raise Stop
            return super().step(actions)

    monkeypatch.setattr(river, "run", partial(run, checkpoint_seconds=0.0))
    monkeypatch.setattr(river, "RiverVectorEnv", BlankEnv)
    ground = RiverTraining(brook, 2, (4,))
    brook_run(ground, encoder, tmp_path / "whole")
    monkeypatch.setattr(river, "RiverVectorEnv", Breaks)
    with pytest.raises(Stop):
        brook_run(ground, encoder, tmp_path / "broken")
    monkeypatch.setattr(river, "RiverVectorEnv", BlankEnv)
    assert brook_run(ground, encoder, tmp_path / "broken").resumed_from == 64
    for name in ("episodes.csv", "policy.safetensors"):
        assert (tmp_path / "broken" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    context = yaml.safe_load((tmp_path / "whole" / "config.yaml").read_text())["run"]["context"]
    assert (context["river"], context["world_seeds"]) == (brook.as_data(), [4])
    assert "level" not in context


def test_a_run_whose_file_has_changed_is_refused_before_a_river_is_built(
    tmp_path: Path, brook: Reach, monkeypatch: pytest.MonkeyPatch
):
    encoder = load_encoder(encoder_file(tmp_path / "0.safetensors", 0))
    monkeypatch.setattr(river, "RiverVectorEnv", BlankEnv)
    brook_run(RiverTraining(brook, 2), encoder, tmp_path / "run", steps=32)
    before = brook.as_data()["content"]
    brook.path.write_text(LINE.replace("9.0004", "9.0005"))
    monkeypatch.setattr(Reach, "build", None)
    now = brook.as_data()["content"]
    with pytest.raises(
        TrainingError, match=f"brook.geojson has changed .* was {before} and is {now} now. Restore the old"
    ):
        brook_run(RiverTraining(brook, 2), encoder, tmp_path / "run", steps=32)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"width_m": 7.0}, "context.river.width_m is 6.0 there and 7.0 here"),
        ({"smooth_m": 2.0}, "context.river.smooth_m is 0.0 there and 2.0 here"),
    ],
)
def test_another_reach_of_the_same_file_is_another_run(
    tmp_path: Path, brook: Reach, monkeypatch: pytest.MonkeyPatch, change: dict[str, float], said: str
):
    encoder = load_encoder(encoder_file(tmp_path / "0.safetensors", 0))
    monkeypatch.setattr(river, "RiverVectorEnv", BlankEnv)
    brook_run(RiverTraining(brook, 2), encoder, tmp_path / "run", steps=32)
    with pytest.raises(TrainingError, match=said):
        brook_run(RiverTraining(replace(brook, **change), 2), encoder, tmp_path / "run", steps=32)


def test_a_run_on_a_level_does_not_resume_on_a_file(tmp_path: Path, brook: Reach, monkeypatch: pytest.MonkeyPatch):
    encoder = load_encoder(encoder_file(tmp_path / "0.safetensors", 0))
    monkeypatch.setattr(river, "RiverVectorEnv", BlankEnv)
    monkeypatch.setattr(river, "load_or_build", lambda *_: ring())
    brook_run(RiverTraining("easy", 2), encoder, tmp_path / "run", steps=32)
    with pytest.raises(TrainingError, match=r"context.level is 'Easy' there and absent here"):
        brook_run(RiverTraining(brook, 2), encoder, tmp_path / "run", steps=32)


def test_a_run_says_on_what_it_was_trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    told: dict[str, Any] = {}
    monkeypatch.setattr(river, "run", lambda *_, **given: told.update(given))
    monkeypatch.setattr(river, "load_or_build", lambda *_: ring())
    monkeypatch.setattr(river, "RiverVectorEnv", partial(RiverVectorEnv, renderer=BlankRenderer(128, 128)))
    encoder = load_encoder(encoder_file(tmp_path / "0.safetensors", 0))
    config = EnvConfig(max_steps=77, camera=Camera(fov_deg=50.0))
    RiverTraining("easy", 2, (3, 5), config).train("PPO", encoder, steps=9, seed=1, folder=tmp_path / "run")
    context = told["context"]
    assert (context["level"], context["world_seeds"], context["encoder"]) == ("Easy", [3, 5], encoder_hash(encoder))
    assert context["env"]["max_steps"] == 77
    assert context["env"]["camera"] == {**Camera().as_data(), "fov_deg": 50.0}
    assert yaml.safe_load(yaml.safe_dump(context)) == context


@pytest.mark.parametrize(
    ("algorithm", "asked", "given", "threads"),
    [
        ("SACLag", "", None, 2),
        ("CCEPETS", "", None, 2),
        ("PPO", "", None, 1),
        ("SACLag", "1", None, 1),
        ("SACLag", "8", None, 2),
        ("PPO", "1", 3, 3),
    ],
)
def test_wide_networks_learn_in_two_threads_unless_another_number_is_given(
    algorithm: str, asked: str, given: int | None, threads: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    found: dict[str, Any] = {}
    monkeypatch.setattr(river, "run", lambda *_, **settings: found.update(settings))
    monkeypatch.setattr(RiverTraining, "_envs", lambda *_, **__: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr("thalweg.core.compute.torch_threads.INITIAL_THREADS", 4)
    monkeypatch.setenv("OMP_NUM_THREADS", asked)
    encoder = load_encoder(encoder_file(tmp_path / "0.safetensors", 0))
    RiverTraining("Easy", 4).train(algorithm, encoder, steps=1, seed=0, folder=tmp_path / "run", threads=given)
    assert found["threads"] == threads


BUILDING = "building the river Easy, seed 3: a few seconds\n"


def test_compilation_starts_with_an_encoder_and_not_for_those_who_see_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    started = []
    monkeypatch.setattr(compilation, "begin", lambda: started.append(True))
    world = ring()
    monkeypatch.setattr("thalweg.bench.evaluate.course.load_or_build", lambda *_: world)
    course = Course.of_level("Easy", EvaluationConfig(episodes=2))
    evaluate(BASELINES["hover"], course, Label("hover", 0, "Easy"), EvaluationConfig(episodes=2))
    assert not started
    load_compatible_encoder(encoder_file(tmp_path / "0.safetensors", 0))
    assert started == [True]


@pytest.mark.parametrize(("inputs", "observation"), [("mask", "mask"), ("rgb", "rgb+mask"), ("rgb+mask", "rgb+mask")])
def test_environments_draw_no_more_than_the_encoder_sees(
    monkeypatch: pytest.MonkeyPatch, inputs: str, observation: str
):
    monkeypatch.setattr(river, "RiverVectorEnv", BlankEnv)
    monkeypatch.setattr(RiverTraining, "worlds", lambda self, **_: [ring()])
    encoder = Encoder(VAE(VAEConfig(inputs=inputs, latent=4)))
    env = RiverTraining("Easy", 2)._envs(encoder, "cpu")
    assert env.env.config.observation == observation
    assert env.reset(seed=0)[0].shape == (2, 4)


def test_an_observation_that_was_chosen_is_kept():
    assert EnvConfig(observation="dict").seen_through("mask").observation == "dict"


def test_a_river_to_be_built_is_announced_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture
):
    world = tmp_path / "world.npz"
    monkeypatch.setattr(river, "cache_path", lambda level, seed: world)
    river.print_once.cache_clear()
    for _ in range(2):
        river.announce_build(LEVELS["Easy"], 3)
    assert capsys.readouterr().err == BUILDING
    river.print_once.cache_clear()
    world.write_bytes(b"")
    river.announce_build(LEVELS["Easy"], 3)
    assert capsys.readouterr().err == ""


def test_the_river_of_a_file_is_always_announced_because_it_is_never_cached(
    capsys: pytest.CaptureFixture,
):
    river.print_once.cache_clear()
    river.announce_build(Reach(Path("rivers/brook.geojson")), 5)
    assert capsys.readouterr().err == "building the river brook.geojson, seed 5: a few seconds\n"


def test_fixed_rivers_say_what_they_take_and_are_refused_if_they_do_not_fit(monkeypatch: pytest.MonkeyPatch, capsys):
    loaded: list[int] = []

    monkeypatch.setattr(river, "drawn_bytes", lambda world: 20_000_000)
    monkeypatch.setattr(river, "announce_build", lambda *_: None)
    monkeypatch.setattr(river, "load_or_build", lambda level, seed: loaded.append(seed))
    monkeypatch.setattr(river, "free_bytes", lambda: 120_000_000)
    river.print_once.cache_clear()
    RiverTraining("Medium", 4, "0:3").worlds()  # pyright: ignore[reportArgumentType]
    assert loaded == [0, 1, 2] and capsys.readouterr().err == "3 rivers, all of them in memory, 60.0 MB\n"
    with pytest.raises(ConfigError, match=r"4 rivers of 20.0 MB need 0.08 GB.* at most 3 fit"):
        RiverTraining("Medium", 4, "0:4").worlds()  # pyright: ignore[reportArgumentType]
    assert loaded == [0, 1, 2, 0]
    monkeypatch.setattr(river, "bytes_of", lambda world: 15_000_000)
    RiverTraining("Medium", 4, "0:4").worlds(drawn=False)  # pyright: ignore[reportArgumentType]
    assert capsys.readouterr().err == "4 rivers, all of them in memory, 60.0 MB\n"
    RiverTraining("Medium", 4).worlds()
    assert capsys.readouterr().err == ""  # a single river says nothing
