"""Tests of bounds of values: what an environment declares, which settings it replaces, and what is said."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
import yaml
from gymnasium.vector import SyncVectorEnv

from tests.train.toys import Walk
from thalweg.algos import ALGORITHMS
from thalweg.train import TrainingError, run
from thalweg.train.episode_bounds import bounds_in_words, declared_bounds, with_declared_bounds

BOTH = {"return": (0, 10), "cost": 1, "costs": (1.0, 0.2)}


def walk(bounds: Any) -> Walk:
    """An environment that declares bounds."""
    env = Walk()
    env.episode_bounds = bounds  # pyright: ignore[reportAttributeAccessIssue]
    return env


def resolved(algorithm: str, given: dict[str, Any], bounds: Any) -> tuple[Any, Any]:
    """The bounds of returns and of costs that an algorithm has in an environment with declared ones."""
    config = with_declared_bounds(ALGORITHMS[algorithm].configure(given), walk(bounds))
    return getattr(config, "return_bounds", None), getattr(config, "largest_costs", None)


@pytest.mark.parametrize(
    ("algorithm", "given", "bounds", "expected"),
    [
        ("TD3Lag", {}, BOTH, ((0.0, 10.0), (1.0,))),
        ("SACLag", {"cost_limits": [0.1, 0.2]}, BOTH, ((0.0, 10.0), (1.0, 0.2))),
        ("TD3Lag", {"return_bounds": [-1.0, 3.0], "largest_costs": [0.5]}, BOTH, ((-1.0, 3.0), (0.5,))),
        ("TD3Lag", {}, {"return": (0, 10)}, ((0.0, 10.0), ())),
        ("TD3Lag", {}, {"costs": (1.0, 0.2)}, ((), ())),
        ("DDPGLag", {}, {}, ((), ())),
        ("DDPGLag", {"normalise_cost": True, "cost_floor": False, "scale_returns": False}, BOTH, ((0.0, 10.0), ())),
        ("SafeLOOP", {}, BOTH, ((0.0, 10.0), None)),
        ("PPOLag", {}, BOTH, (None, None)),
    ],
)
def test_declared_bounds_replace_those_that_are_not_given(algorithm: str, given: Any, bounds: Any, expected: Any):
    assert resolved(algorithm, given, bounds) == expected


def test_without_a_declaration_the_config_is_the_same_object():
    config = ALGORITHMS["TD3Lag"].configure({})
    assert with_declared_bounds(config, Walk()) is config


class Declared(gym.Env):
    """A single environment that declares bounds."""

    observation_space = gym.spaces.Box(-1.0, 1.0, (2,))
    action_space = gym.spaces.Discrete(2)
    episode_bounds = {"cost": 2.0}  # noqa: RUF012


def test_a_vector_of_single_environments_declares_what_these_do():
    assert declared_bounds(SyncVectorEnv([Declared, Declared])) == {"cost": (2.0,)}


class Doubled(gym.Wrapper):
    """A wrapper from elsewhere, which may change rewards and costs."""

    def step(self, action: Any) -> Any:
        obs, reward, terminated, truncated, info = self.env.step(action)
        return obs, 2 * float(reward), terminated, truncated, info | {"cost": 2 * info["cost"]}


class Marked(gym.Wrapper):
    """A wrapper from elsewhere that leaves steps alone."""


def declaring() -> gym.Env:
    env: Any = Declared()
    env.episode_bounds = BOTH
    return env


ALL, COSTS = {"return", "cost", "costs"}, {"cost", "costs"}


@pytest.mark.parametrize(
    ("wrap", "kept"),
    [
        (lambda env: gym.wrappers.TimeLimit(env, 5), ALL),
        (Marked, ALL),
        (lambda env: gym.wrappers.TransformReward(env, lambda reward: 2 * float(reward)), COSTS),
        (lambda env: gym.wrappers.TimeLimit(gym.wrappers.NormalizeReward(env), 5), COSTS),
        (lambda env: gym.wrappers.RepeatAction(env, 2), set()),
        (Doubled, set()),
    ],
)
def test_bounds_of_what_a_wrapper_may_change_do_not_hold_around_it(wrap: Any, kept: set[str]):
    assert set(declared_bounds(wrap(declaring()))) == kept
    assert set(declared_bounds(SyncVectorEnv([lambda: wrap(declaring())]))) == kept


@pytest.mark.parametrize(
    ("wrap", "kept"),
    [
        (gym.wrappers.vector.RecordEpisodeStatistics, ALL),
        (lambda envs: gym.wrappers.vector.TransformReward(envs, lambda reward: 2 * reward), COSTS),
        (gym.wrappers.vector.NormalizeReward, COSTS),
    ],
)
def test_bounds_of_what_a_wrapper_of_vectors_may_change_do_not_hold_around_it(wrap: Any, kept: set[str]):
    assert set(declared_bounds(wrap(walk(BOTH)))) == kept


def test_a_wrapper_that_changes_rewards_may_declare_bounds_of_its_own():
    env: Any = Doubled(declaring())
    env.episode_bounds = {"return": (0, 20)}
    assert declared_bounds(env) == {"return": (0.0, 20.0)}


@pytest.mark.parametrize(
    ("bounds", "words"),
    [
        ([0, 1], r"must be a mapping with some of the keys 'return', 'cost' and 'costs', got \[0, 1\]"),
        ({"returns": (0, 1)}, "must be a mapping with some of the keys"),
        ({"return": (1, 0)}, r"\['return'\] must be two finite numbers, the smaller one first, got \(1, 0\)"),
        ({"return": (0, float("inf"))}, r"\['return'\] must be two finite numbers"),
        ({"return": 10}, r"\['return'\] must be two finite numbers"),
        ({"cost": -1.0}, r"\['cost'\] must be a finite number, not negative, got -1.0"),
        ({"cost": (1.0,)}, r"\['cost'\] must be a finite number"),
        ({"costs": (1.0,)}, r"\['costs'\] must be two finite numbers, tight and loose, not negative, got \(1.0,\)"),
        ({"costs": (1.0, float("nan"))}, r"\['costs'\] must be two finite numbers"),
    ],
)
def test_wrong_bounds_are_refused(bounds: Any, words: str):
    with pytest.raises(TrainingError, match=words):
        declared_bounds(walk(bounds))


def test_a_run_records_declared_bounds_says_so_and_resumes(tmp_path: Path, capsys: pytest.CaptureFixture):
    small = {"random_steps": 64, "hidden": [4], "steps_per_update": 64}
    given: dict[str, Any] = {"steps": 320, "seed": 1, "folder": tmp_path, "config": small}
    run("TD3Lag", walk({"return": (0, 10)}), progress=True, **given)
    recorded = yaml.safe_load((tmp_path / "config.yaml").read_text())["run"]["config"]
    assert (recorded["return_bounds"], recorded["largest_costs"]) == ([0.0, 10.0], [])
    said = "Values are kept within return_bounds (0.0, 10.0), which the environment declares. Values are kept near the"
    assert f"{said} range of costs seen so far" in capsys.readouterr().err
    assert run("TD3Lag", walk({"return": (0, 10)}), **given).already_finished
    with pytest.raises(TrainingError, match="return_bounds"):
        run("TD3Lag", Walk(), **given)


NEAR, DEFAULT = "Values are kept near the range of", "seen so far, which is the default; for fixed bounds set"


@pytest.mark.parametrize(
    ("algorithm", "given", "line"),
    [
        ("TD3Lag", {}, f"{NEAR} returns and costs {DEFAULT} return_bounds and largest_costs."),
        ("TD3Lag", {"return_bounds": [0, 10]}, f"{NEAR} costs {DEFAULT} largest_costs."),
        ("TD3Lag", {"return_bounds": [0, 10], "largest_costs": [1.0]}, ""),
        ("TD3Lag", {"bound_targets": False}, ""),
        ("CCEPETS", {}, f"{NEAR} returns {DEFAULT} return_bounds."),
        ("CCEPETS", {"terminal_value": False}, ""),
        ("PPO", {}, ""),
    ],
)
def test_bounds_of_values_that_a_task_does_not_give_are_named(algorithm: str, given: dict[str, Any], line: str):
    config = ALGORITHMS[algorithm].configure(given)
    assert bounds_in_words(config, config) == line
