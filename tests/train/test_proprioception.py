"""Tests of policies that take proprioception beside codes or the privileged observation."""

import copy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from gymnasium.vector import AutoresetMode

from tests.env.handmade import BlankMaskRenderer, BlankRenderer, canal, ring
from tests.render.plain import plane
from thalweg.algos import Policy
from thalweg.algos.policy.policy_file import About
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, evaluate
from thalweg.core import versions
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.rivers import river_list
from thalweg.env.torch_env import TensorRiverEnv
from thalweg.train import LatentTensorEnv, LatentVectorEnv, load_policy, river, run
from thalweg.train.errors import TrainingError
from thalweg.train.numbers import NumbersTensorEnv, NumbersVectorEnv
from thalweg.train.observations import check_policy_fits, feels
from thalweg.train.river import RiverTraining

SMALL = {"steps_per_update": 64, "minibatch": 32, "passes": 1, "hidden": [8], "critic_warmup_steps": 0}
FELT = {"proprioception_version": versions.PROPRIOCEPTION}
EYE = {"observation": "privileged", "privileged_version": versions.PRIVILEGED}


class FirstPixels:
    """An encoder whose code is the first two numbers of an image's first row, in each channel."""

    latent, inputs, about = 2, "mask", {"path": __file__}
    config = SimpleNamespace(size_px=128)
    device = torch.device("cpu")

    def __call__(self, frames: np.ndarray) -> np.ndarray:
        return frames[:, 0, :2, -1].astype(np.float32)

    def of_tensor(self, frames: torch.Tensor) -> torch.Tensor:
        return frames[:, 0, :2, -1].float()


@pytest.fixture
def rings(monkeypatch: pytest.MonkeyPatch) -> None:
    """All rivers are rings made by hand."""
    monkeypatch.setattr(river_list, "load_or_plan", lambda *_: ring())
    monkeypatch.setattr(river, "load_or_build", lambda *_: ring())


def train(folder: Path, encoder: Any = None, algorithm: str = "PPO", steps: int = 192, **options: Any) -> Any:
    where = options.pop("where", RiverTraining("Easy", 4))
    given = {"settings": SMALL, "proprioception": True} | options
    return where.train(algorithm, encoder, steps=steps, seed=3, folder=folder, **given)


def tensors(folder: Path) -> np.ndarray:
    return load_policy(folder).actor.stack.flat.detach().numpy()


@pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.name)
def test_codes_come_first_and_then_what_is_felt_in_every_mode(mode: AutoresetMode):
    config = EnvConfig(observation=("mask", "proprioception"), max_steps=6)
    plain, coded = (
        RiverVectorEnv(ring(), 3, config, renderer=BlankMaskRenderer(), autoreset_mode=mode) for _ in range(2)
    )
    env, encoder = LatentVectorEnv(coded, FirstPixels()), FirstPixels()
    assert env.single_observation_space.shape == (11,) and env.observation_space.shape == (3, 11)
    together = lambda obs: np.concatenate([encoder(obs["mask"]), obs["proprioception"]], -1)  # noqa: E731
    theirs, ours = plain.reset(seed=1)[0], env.reset(seed=1)[0]
    random, ends = np.random.default_rng(0), 0
    for _ in range(14):
        np.testing.assert_array_equal(ours, together(theirs))
        assert ours.dtype == np.float32
        actions = random.integers(0, 3, (3, 4))
        (theirs, _, terminated, truncated, told), (ours, *_, info) = plain.step(actions), env.step(actions)
        assert ("final_obs" in told) == ("final_obs" in info)
        for row in np.flatnonzero(terminated | truncated):
            ends += 1
            if mode is AutoresetMode.SAME_STEP:
                last = {part: array[None] for part, array in told["final_obs"][row].items()}
                np.testing.assert_array_equal(info["final_obs"][row], together(last)[0])
        if mode is AutoresetMode.DISABLED and (done := terminated | truncated).any():
            theirs, ours = (each.reset(options={"reset_mask": done})[0] for each in (plain, env))
    assert ends > 3


def test_the_privileged_observation_comes_first_too():
    config = EnvConfig(observation=("privileged", "proprioception"), max_steps=5)
    env, seen = NumbersVectorEnv(RiverVectorEnv(ring(), 2, config)), RiverVectorEnv(
        ring(), 2, config.with_options(observation="privileged")
    )  # fmt: skip
    start = {"pose": [20.0, 0.0, 3.0, 1.6]}
    ours, theirs = (each.reset(seed=1, options=start)[0] for each in (env, seen))
    assert env.single_observation_space.shape == (46,) and ours.shape == (2, 46)
    for _ in range(4):
        np.testing.assert_array_equal(ours[:, :37], theirs)
        np.testing.assert_allclose(ours[:, 37], theirs[:, 3], rtol=1e-6)  # the height
        ours, theirs = (each.step(np.array([[0, 1, 0, 1]] * 2))[0] for each in (env, seen))
    info = env.step(np.array([[0, 1, 0, 1]] * 2))[-1]
    assert info["final_obs"][0].shape == (46,) and info["final_obs"][0][40] == 4.0  # it climbed
    assert env.get_state()["last_action"].shape == (2, 4)


@pytest.mark.parametrize(
    ("parts", "wrapped", "first"),
    [
        (
            ("mask", "proprioception"),
            lambda env: LatentTensorEnv(env, FirstPixels()),
            lambda obs: FirstPixels().of_tensor(obs["mask"]),
        ),
        (("privileged", "proprioception"), NumbersTensorEnv, lambda obs: obs["privileged"]),
    ],
    ids=["codes", "privileged"],
)
def test_environments_of_tensors_have_the_same_observations(parts: Any, wrapped: Any, first: Any):
    config = EnvConfig(observation=parts)
    plain, joined = (TensorRiverEnv(plane(), 3, config, device="cpu") for _ in range(2))
    env = wrapped(joined)
    ours, theirs = env.reset(seed=2)[0], plain.reset(seed=2)[0]
    for _ in range(3):
        assert torch.equal(ours, torch.cat([first(theirs), theirs["proprioception"]], 1))
        assert ours.shape[1:] == env.single_observation_space.shape
        ours, theirs = (each.step(torch.zeros(3, 4, dtype=torch.int64))[0] for each in (env, plain))
    twin = copy.deepcopy(env)
    ours, theirs = (each.step(torch.zeros(3, 4, dtype=torch.int64))[0] for each in (env, twin))
    assert torch.equal(ours, theirs)


def test_a_run_is_that_on_the_joined_environment_and_says_so(tmp_path: Path, rings: None):
    train(tmp_path / "river")
    config = EnvConfig(observation=("privileged", "proprioception"), critic_info=True)
    env = NumbersVectorEnv(RiverVectorEnv([ring()], 4, config))
    run("PPO", env, steps=192, seed=3, folder=tmp_path / "plain", config=SMALL)
    episodes = [(tmp_path / name / "episodes.csv").read_text() for name in ("river", "plain")]
    assert episodes[0] == episodes[1] and len(episodes[0].splitlines()) > 2
    np.testing.assert_array_equal(tensors(tmp_path / "river"), tensors(tmp_path / "plain"))
    policy = load_policy(tmp_path / "river")
    recorded = yaml.safe_load((tmp_path / "river" / "config.yaml").read_text())["run"]["context"]
    assert policy.obs_size == 46 and feels(policy) and policy.about.context == recorded
    assert {key: recorded[key] for key in (*EYE, *FELT)} == EYE | FELT
    assert recorded["env"]["observation"] == ["proprioception", "privileged"]
    train(tmp_path / "config", proprioception=False, where=RiverTraining("Easy", 4, config=EnvConfig(
        observation=("privileged", "proprioception"))))  # fmt: skip
    np.testing.assert_array_equal(tensors(tmp_path / "river"), tensors(tmp_path / "config"))


def test_a_run_on_codes_draws_what_the_encoder_sees_and_resumes(
    tmp_path: Path, rings: None, monkeypatch: pytest.MonkeyPatch
):
    made: list[EnvConfig] = []

    class Masks(RiverVectorEnv):
        def __init__(self, worlds: Any, num_envs: int, config: EnvConfig) -> None:
            made.append(config)
            super().__init__(worlds, num_envs, config, renderer=BlankMaskRenderer())

    monkeypatch.setattr(river, "RiverVectorEnv", Masks)
    train(tmp_path, FirstPixels(), "FOCOPS")
    assert made[0].observation == ("mask", "proprioception")
    policy = load_policy(tmp_path)
    assert (policy.obs_size, feels(policy)) == (11, True)
    context = policy.about.context
    assert context["proprioception_version"] == versions.PROPRIOCEPTION and "observation" not in context
    assert train(tmp_path, FirstPixels(), "FOCOPS").already_finished
    with pytest.raises(TrainingError, match="proprioception_version is 1 there and absent here"):
        train(tmp_path, FirstPixels(), "FOCOPS", proprioception=False)


def test_a_run_begins_with_a_policy_that_feels_the_same(tmp_path: Path, rings: None):
    train(tmp_path / "with", steps=64)
    train(tmp_path / "without", steps=64, proprioception=False)
    train(tmp_path / "then", steps=64, begin_with=tmp_path / "with")
    for begun, here in (("with", False), ("without", True)):
        words = "trained without proprioception, but here it would fly with" if here else "trained with proprioception"
        with pytest.raises(TrainingError, match=words):
            train(tmp_path / "refused", steps=64, begin_with=tmp_path / begun, proprioception=here)
    assert not (tmp_path / "refused").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"settings": {**SMALL, "policy": "cnn"}}, "policy=cnn sees images alone: leave proprioception out"),
        (
            {"where": RiverTraining("Easy", 4, config=EnvConfig(observation=("depth", "proprioception")))},
            "a policy of the privileged observation does not see depth: leave that out",
        ),
        (
            {
                "encoder": FirstPixels(),
                "where": RiverTraining("Easy", 4, config=EnvConfig(observation=("mask", "class", "proprioception"))),
            },
            "a policy of frames through an encoder does not see class: leave that out",
        ),
    ],
    ids=["images", "depth", "class"],
)
def test_what_makes_no_sense_is_refused_before_a_river_is_built(tmp_path: Path, options: dict, message: str):
    with pytest.raises(TrainingError, match=message):
        train(tmp_path / "run", **options)
    assert not (tmp_path / "run").exists()


def policy_with(size: int, context: dict[str, Any]) -> Policy:
    actions = RiverVectorEnv(ring(), 1, EnvConfig(observation="none")).single_action_space
    from thalweg.algos.policy.actions import actions_of

    return Policy(size, actions_of(actions), about=About("PPO", {}, context))


def test_a_policy_fits_by_its_size_and_by_the_version_of_what_it_felt():
    encoder: Any = SimpleNamespace(latent=16, about={"path": __file__})
    check_policy_fits(policy_with(25, FELT), encoder)
    check_policy_fits(policy_with(46, EYE | FELT), None)
    with pytest.raises(TrainingError, match="takes 16 numbers, but the encoder and proprioception together returns 25"):
        check_policy_fits(policy_with(16, FELT), encoder)
    with pytest.raises(TrainingError, match="version 0 of proprioception, but this is version 1; train it again"):
        check_policy_fits(policy_with(25, {"proprioception_version": 0}), encoder)


class Recorder:
    """A policy that flies ahead, climbs, and writes down what it sees."""

    def __init__(self, context: dict[str, Any]) -> None:
        self.about, self.saw = About("PPO", {}, context), []

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        self.saw.append(obs.copy())
        return np.tile([0, 1, 0, 1], (len(obs), 1))


@pytest.mark.parametrize("context", [EYE | FELT, {"encoder": "ab"} | FELT], ids=["privileged", "codes"])
def test_an_evaluation_shows_a_policy_what_it_felt_in_training(context: dict[str, Any]):
    river, recorder = canal(length_m=60.0, level_m=0.5), Recorder(context)
    starts = np.array([[20.0, 0.0, 5.0, 0.0], [5.0, 1.0, 4.0, 0.1]])
    codes = None if "observation" in context else lambda step: step.poses[:, :2].astype(np.float32)
    label, config = Label("recorder", 0, "Easy"), EvaluationConfig(episodes=2)
    rows = evaluate(recorder, Course(river, starts, np.zeros(2), np.arange(2)), label, config, observe=codes)
    env = RiverVectorEnv(river, 2, EnvConfig(observation=("privileged", "proprioception")))
    obs, info = env.reset(seed=0, options={"pose": starts})
    for step in range(min(row.length for row in rows)):
        seen = obs["privileged"] if codes is None else info["pose"][:, :2].astype(np.float32)
        both = np.concatenate(recorder.saw[2 * step : 2 * step + 2])
        np.testing.assert_array_equal(both, np.concatenate([seen, obs["proprioception"]], 1))
        obs, *_, info = env.step(np.tile([0, 1, 0, 1], (2, 1)))
    assert len(recorder.saw) == sum(row.length for row in rows) > 10


def test_a_wrapper_needs_the_parts_it_joins():
    mask = RiverVectorEnv(ring(), 1, EnvConfig(observation=("mask",)), renderer=BlankRenderer())
    with pytest.raises(TrainingError, match="observations must be numbers without an image"):
        NumbersVectorEnv(mask)
    felt = RiverVectorEnv(ring(), 1, EnvConfig(observation=("proprioception",)))
    with pytest.raises(TrainingError, match="an encoder needs images"):
        LatentVectorEnv(felt, FirstPixels())
