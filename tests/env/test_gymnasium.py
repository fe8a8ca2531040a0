"""Gymnasium's own checkers, its registry, and what its other vector environments make of ours."""

import subprocess
import sys
import warnings
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.utils.passive_env_checker import data_shares_objects
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import thalweg
from tests.env.handmade import BlankRenderer, hairpin, ring
from thalweg.env import ActionError, ConfigError, EnvConfig, RiverEnv, RiverVectorEnv, UnknownOptionError


@pytest.mark.parametrize("observation", ["rgb+mask", "rgb", "mask", "dict"])
@pytest.mark.parametrize("action", ["multidiscrete", "continuous"])
def test_gymnasiums_checker_passes_without_a_warning(observation: str, action: str):
    env = gymnasium.make(
        "thalweg/Medium-v0",
        world=ring(),
        renderer=BlankRenderer(),
        observation=observation,
        action=action,
        render_mode="rgb_array",
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


@pytest.mark.parametrize(
    ("action", "found"),
    [
        ([0, 1, 1], r"not \[0, 1, 1\]$"),
        (2, "not 2$"),
        ([[0, 1, 1, 1]], r"not \[\[0, 1, 1, 1\]\]$"),
        ([0, [1, 1], 1, 1], r"not \[0, \[1, 1\], 1, 1\]$"),
        (np.zeros((128, 128, 4)), r"not an array of shape \(128, 128, 4\)$"),
    ],
    ids=str,
)
def test_an_action_of_another_shape_is_named_as_it_was_given_and_changes_nothing(action, found: str):
    env = RiverEnv(ring(), EnvConfig(observation="none"))
    env.reset(seed=0)
    before = env.get_state()
    needed = "an action is four numbers, one each for vertical, yaw, longitudinal, lateral, "
    with pytest.raises(ActionError, match=needed + found):
        env.step(action)
    assert all(np.array_equal(value, before[key]) for key, value in env.get_state().items())


@pytest.mark.parametrize("name", ["Easy", "Medium", "Hard"])
def test_every_level_is_registered_with_both_kinds(name: str):
    spec = gymnasium.spec(thalweg.LEVEL_IDS[name])
    assert spec.entry_point == "thalweg.env:make_single"
    assert spec.vector_entry_point == "thalweg.env:make_vector"
    assert spec.kwargs == {"level": name}
    assert spec.max_episode_steps is None


def test_make_vec_gives_the_native_environment():
    env = gymnasium.make_vec(
        "thalweg/Medium-v0",
        num_envs=5,
        worlds=[ring(), hairpin()],
        renderer=BlankRenderer(),
        reward_scheme="package",
        autoreset_mode=AutoresetMode.NEXT_STEP,
    )
    assert isinstance(env, RiverVectorEnv)
    assert (env.num_envs, len(env.worlds), env.config.reward_scheme) == (5, 2, "package")
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP


def test_gymnasiums_name_of_the_step_limit_leads_to_that_of_the_option():
    with pytest.raises(ConfigError, match="'max_episode_steps': the option is called 'max_steps' here"):
        gymnasium.make_vec("thalweg/Easy-v0", num_envs=2, worlds=ring(), max_episode_steps=3)


def test_make_vec_is_same_step_unless_asked_otherwise():
    env = gymnasium.make_vec("thalweg/Easy-v0", num_envs=2, worlds=ring(), observation="none")
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert env.num_envs == 2


def test_gymnasiums_own_vectors_are_next_step_unless_asked_otherwise():
    given = {"num_envs": 2, "vectorization_mode": "sync", "world": ring(), "observation": "none"}
    env = gymnasium.make_vec("thalweg/Easy-v0", **given)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    same_step = {"autoreset_mode": AutoresetMode.SAME_STEP}
    env = gymnasium.make_vec("thalweg/Easy-v0", vector_kwargs=same_step, **given)
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_an_unknown_option_lists_the_known_ones(make):
    with pytest.raises(ConfigError, match=r"'heigth'.*observation"):
        make("thalweg/Easy-v0", heigth=3)


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_an_unknown_option_is_told_in_pythons_words_too(make):
    """TorchRL tries `frameskip`, and goes on without it where this is the error."""
    with pytest.raises(TypeError) as raised:
        make("thalweg/Easy-v0", frameskip=1, quality="fast")
    assert "unexpected keyword argument 'frameskip'" in str(raised.value)
    assert "unknown option 'frameskip'; known: " in str(raised.value)
    assert type(raised.value) is UnknownOptionError and isinstance(raised.value, ConfigError)


def test_a_known_option_with_a_wrong_value_is_no_type_error():
    with pytest.raises(ConfigError) as raised:
        gymnasium.make("thalweg/Easy-v0", world=ring(), observation="colour")
    assert not isinstance(raised.value, TypeError)


def test_the_info_of_one_environment_holds_numpys_scalars_and_arrays():
    env = RiverEnv(ring(), EnvConfig(observation="none"))
    for info in (env.reset(seed=0)[1], env.step([1, 1, 1, 1])[4]):
        kinds = {name: np.asarray(value).dtype.kind for name, value in info.items()}
        assert all(isinstance(value, np.generic | np.ndarray) for value in info.values())
        assert (kinds["cost"], kinds["progress"], kinds["done_reason"], kinds["pose"]) == ("f", "f", "i", "f")
        assert np.shape(info["cost"]) == np.shape(info["done_reason"]) == ()


def test_worlds_and_seeds_of_worlds_exclude_each_other():
    with pytest.raises(ConfigError, match="not both"):
        gymnasium.make_vec("thalweg/Easy-v0", worlds=[ring()], world_seeds=[1])


@pytest.mark.parametrize(
    ("make", "wrong", "message"),
    [
        (gymnasium.make, {"world_seed": 1.7}, r"world_seed must be a whole number.*1\.7"),
        (gymnasium.make, {"world_seed": -1}, "world_seed must be a whole number.*-1"),
        (gymnasium.make, {"world_seed": True}, "world_seed must be a whole number.*True"),
        (gymnasium.make, {"level": 3}, "level must be a name, not 3"),
        (gymnasium.make_vec, {"world_seeds": 1.5}, r"world_seeds must be whole numbers.*not 1\.5"),
        (gymnasium.make_vec, {"world_seeds": [1, "x"]}, "world_seeds must be whole numbers.*'x'"),
        (gymnasium.make_vec, {"world_seeds": []}, "at least one"),
    ],
)
def test_a_world_that_cannot_be_named_is_refused(make, wrong: dict, message: str):
    with pytest.raises(ConfigError, match=message):
        make("thalweg/Easy-v0", **wrong)


def test_seeds_of_worlds_may_be_an_array(monkeypatch: pytest.MonkeyPatch):
    asked = []
    monkeypatch.setattr("thalweg.world.load_or_build", lambda level, seed: asked.append((level, seed)) or ring())
    gymnasium.make_vec("thalweg/Easy-v0", num_envs=2, world_seeds=np.array([4, 2]), observation="none")
    assert asked == [("Easy", 4), ("Easy", 2)]
    assert all(type(seed) is int for _, seed in asked)


def test_frames_are_shown_as_fast_as_time_passes():
    config = EnvConfig(observation="none", step_s=0.5)
    assert RiverEnv.metadata["render_fps"] == RiverVectorEnv.metadata["render_fps"] == 4
    assert RiverEnv(ring(), config).metadata["render_fps"] == RiverVectorEnv(ring(), 1, config).metadata["render_fps"]
    assert RiverEnv(ring(), config).metadata["render_fps"] == 2


def test_the_name_of_the_module_in_front_of_an_id_stands_for_its_import():
    code = (
        "import gymnasium; from tests.env.handmade import ring; "
        "env = gymnasium.make('thalweg:thalweg/Easy-v0', world=ring(), observation='none'); "
        "print(env.spec.kwargs['level'])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "Easy"


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP])
def test_ours_agrees_with_gymnasiums_vector_of_single_environments(mode: AutoresetMode):
    config = EnvConfig(max_idle_steps=6)
    ours = RiverVectorEnv(ring(), 3, config, renderer=BlankRenderer(), autoreset_mode=mode)
    theirs = SyncVectorEnv(
        [lambda: RiverEnv(ring(), config, renderer=BlankRenderer()) for _ in range(3)], autoreset_mode=mode
    )
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    first, _ = ours.reset(seed=5)
    assert np.array_equal(first, theirs.reset(seed=5)[0])
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(120):
        actions = rng.integers(0, 3, size=(3, 4))
        a, b = ours.step(actions), theirs.step(actions)
        assert all(np.array_equal(x, y) for x, y in zip(a[:4], b[:4], strict=True))
        assert ("final_obs" in a[4]) == ("final_obs" in b[4])
        if "final_obs" in b[4]:
            ended += 1
            assert np.array_equal(a[4]["_final_obs"], b[4]["_final_obs"])
            assert data_equivalence(a[4]["final_info"], b[4]["final_info"])
    assert mode is AutoresetMode.NEXT_STEP or ended > 5


def test_the_vector_environment_keeps_gymnasiums_contract():
    """What `check_env` asks of one environment, asked of many: spaces, seeds, determinism, data of its own."""
    env = gymnasium.make_vec("thalweg/Medium-v0", num_envs=3, worlds=ring(), renderer=BlankRenderer())
    first, info = env.reset(seed=1)
    again, info_again = env.reset(seed=1)
    assert first in env.observation_space
    assert data_equivalence(first, again, exact=True)
    assert data_equivalence(info, info_again, exact=True)
    assert not data_shares_objects(first, again)
    assert not data_shares_objects(info, info_again)
    env.action_space.seed(0)
    action = env.action_space.sample()
    results = []
    for _ in range(2):
        env.reset(seed=1)
        results.append(env.step(action))
    assert data_equivalence(results[0], results[1], exact=True)
    assert not data_shares_objects(results[0][4], results[1][4])
    _, rewards, terminated, truncated, _ = results[0]
    assert (rewards.dtype, terminated.dtype, truncated.dtype) == (np.float64, bool, bool)
    assert rewards.shape == terminated.shape == truncated.shape == (3,)
    env.close()
    env.close()


def test_importing_the_package_loads_neither_torch_nor_numba():
    code = "import sys, thalweg; print(sorted({'torch', 'numba', 'scipy', 'thalweg.env'} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_seeds_choose_the_rivers_of_each_kind_of_environment(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("thalweg.world.load_or_build", lambda level, seed: replace(ring(), name=level, seed=seed))
    one = gymnasium.make("thalweg/Easy-v0", world_seed=4, observation="none").unwrapped
    many = gymnasium.make_vec("thalweg/Easy-v0", num_envs=2, world_seeds=[4, 2], observation="none")
    tensors = thalweg.make_torch("Easy", 2, world_seeds="4 2", observation="none", device="cpu")
    assert [world.label for world in one.vector.worlds] == ["Easy-4"]  # pyright: ignore[reportAttributeAccessIssue]
    for each in (many, tensors):
        assert [world.label for world in each.worlds] == ["Easy-4", "Easy-2"]  # pyright: ignore[reportAttributeAccessIssue]


def test_make_vec_passes_the_render_mode_on():
    options = {"worlds": ring(), "renderer": BlankRenderer(), "render_mode": "rgb_array"}
    env = gymnasium.make_vec("thalweg/Easy-v0", num_envs=2, **options)
    env.reset(seed=0)
    assert [np.shape(frame) for frame in env.render() or ()] == [(8, 8, 3)] * 2
