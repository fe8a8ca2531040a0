"""Tests of functions that fly: what they see, what they must return, and what their rows bear."""

import functools
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.baselines import BASELINES, Constant, sight_of
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.episodes import read_episodes, write_episodes
from thalweg.bench.evaluate.evaluation import Label, evaluate, player_of
from thalweg.bench.evaluate.functions import FunctionPolicy, is_reference
from thalweg.core.plugins.record import PluginError
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.forces.options import ForceOptions
from thalweg.train.observations import check_policy_fits
from thalweg.world import World

CONFIG = EvaluationConfig(episodes=3)
LABEL = Label("ahead", 0, "Easy")


def ahead(obs: np.ndarray) -> list[int]:
    """Fly straight ahead."""
    return [1, 1, 0, 1]


def fly(function: Any, world: World, **given: Any) -> list:
    policy = FunctionPolicy(function, observation="privileged", **given)
    return evaluate(policy, Course.on(world, CONFIG), LABEL, CONFIG)


def test_a_function_flies_as_the_baseline_that_does_the_same(easy_world: World):
    rows = fly(ahead, easy_world)
    expected = evaluate(BASELINES["forward"], Course.on(easy_world, CONFIG), LABEL, CONFIG)
    assert [(row.return_, row.length, row.reason) for row in rows] == [
        (row.return_, row.length, row.reason) for row in expected
    ]


def test_options_of_a_function_are_commands_of_inertial_dynamics(easy_world: World):
    rules = ForceOptions(dynamics="inertial").applied(EnvConfig(observation="none"))
    config = EvaluationConfig(episodes=2, env=rules)
    course, moves = Course.on(easy_world, config), [1, 2, 0, 2]
    policies = (
        FunctionPolicy(lambda _: moves, name="mine", observation="privileged", source="1"),
        Constant((1, 2, 0, 2)),
    )
    found, wanted = (evaluate(policy, course, LABEL, config) for policy in policies)
    assert [(row.return_, row.length, row.reason, row.end_x) for row in found] == [
        (row.return_, row.length, row.reason, row.end_x) for row in wanted
    ]


def test_rows_bear_version_and_hash_of_the_function_and_files_keep_them(easy_world: World, tmp_path: Path):
    rows = fly(ahead, easy_world, version=3)
    source = FunctionPolicy(ahead).source
    assert {(row.version, row.source) for row in rows} == {(3, source)}
    assert re.fullmatch("[0-9a-f]{16}", source)
    write_episodes(tmp_path / "rows.csv", rows)
    assert read_episodes(tmp_path / "rows.csv") == rows
    others = evaluate(BASELINES["hover"], Course.on(easy_world, CONFIG), LABEL, CONFIG)
    write_episodes(tmp_path / "others.csv", others)
    assert "version" not in (tmp_path / "others.csv").read_text()
    assert read_episodes(tmp_path / "others.csv") == others


def test_a_function_sees_the_observation_of_its_own_episode(easy_world: World):
    seen: list[np.ndarray] = []

    def look(obs: np.ndarray) -> np.ndarray:
        seen.append(obs)
        return np.array([1, 1, 1, 1])

    fly(look, easy_world)
    course = Course.on(easy_world, CONFIG)
    env = RiverVectorEnv([easy_world], 3, CONFIG.env)
    env.reset(seed=0, options={"pose": course.starts})
    eye = env.ideal_eye()
    assert all(np.array_equal(*pair) for pair in zip(seen[:3], eye, strict=True))


class Counting:
    """Remembers how often it was asked in its episode, and turns every second time."""

    observation = "privileged"
    version = 2
    label = "Counting"
    objects = 0

    def __init__(self) -> None:
        Counting.objects += 1
        self.asked = 0

    def __call__(self, obs: np.ndarray) -> list[int]:
        self.asked += 1
        return [1, 2 * (self.asked % 2), 0, 1]


def test_of_a_class_each_episode_has_an_object_of_its_own(easy_world: World):
    Counting.objects = 0
    policy = FunctionPolicy(Counting)
    assert (policy.name, policy.version, policy.observation) == ("Counting", 2, "privileged")
    together = evaluate(policy, course := Course.on(easy_world, CONFIG), LABEL, CONFIG)
    assert Counting.objects == 3
    alone = evaluate(policy, course.only(1), LABEL, CONFIG)
    assert alone == [together[1]]


@pytest.mark.parametrize(
    ("observation", "sees"),
    [("rgb+mask", "images"), ("mask", "images"), ("privileged", "privileged"), ("frames", "frames")],
)
def test_what_it_sees_is_what_it_says(observation: str, sees: str):
    policy = FunctionPolicy(ahead, observation=observation)
    assert (sight_of(policy), policy.observation) == (sees, observation)
    if sees != "frames":
        check_policy_fits(policy, None)


def test_one_that_says_nothing_sees_colours_and_mask():
    assert FunctionPolicy(ahead).observation == "rgb+mask"


@pytest.mark.parametrize(
    "given", [None, 1, [1, 1, 1], [1, 1, 1, 3], [-1, 1, 1, 1], [1.0, 1.0, 1.0, 1.0], [True] * 4, np.ones((1, 4), int)]
)
def test_anything_but_an_action_is_refused_by_name(given: Any, easy_world: World):
    with pytest.raises(
        ResultsError, match=r"given_wrong returned .* for an observation float32 \[37\]; an action is four"
    ):
        fly(lambda obs: given, easy_world, name="given_wrong")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"function": 3}, "3 cannot fly: a function is needed"),
        ({"name": "a b"}, "the name 'a b' of a function must be letters, digits, - and ."),
        ({"name": "render"}, "the name 'render' of a function is that of another version in results"),
        ({"version": 0}, "the version of ahead is 0; it must be a whole number of 1 or more"),
        ({"observation": "depth"}, "ahead sees 'depth'; a function may see rgb+mask, rgb, mask, privileged, frames"),
    ],
)
def test_what_cannot_fly_is_refused(changes: dict[str, Any], words: str):
    with pytest.raises(ResultsError, match=re.escape(words)):
        given: dict[str, Any] = {"function": ahead} | changes
        FunctionPolicy(**given)


def test_a_function_is_loaded_from_a_file_or_a_module(tmp_path: Path):
    file = tmp_path / "mine.py"
    file.write_text("def fly(obs):\n    return [1, 1, 0, 1]\n\n\nfly.version = 4\nfly.observation = 'mask'\n")
    policy = FunctionPolicy.load(f"{file}:fly", "Mine")
    assert (policy.name, policy.version, policy.observation) == ("Mine", 4, "mask")
    again = FunctionPolicy.load("tests.bench.evaluate.test_functions:ahead")
    assert again.function.__name__ == "ahead"
    with pytest.raises(PluginError, match=r"mine\.py has no 'flow' at its top level; it has fly"):
        FunctionPolicy.load(f"{file}:flow")
    with pytest.raises(PluginError, match=r"there is no file .*other\.py; '.*other\.py:fly' must name one"):
        FunctionPolicy.load(f"{tmp_path / 'other.py'}:fly")
    with pytest.raises(PluginError, match="nowhere_at_all cannot be imported: ModuleNotFoundError"):
        FunctionPolicy.load("nowhere_at_all:fly")
    file.write_text("x = 1\n1 / 0\n")
    with pytest.raises(PluginError, match=r"mine\.py, line 2: ZeroDivisionError"):
        FunctionPolicy.load(f"{file}:fly")


def along(speed: Any, obs: np.ndarray, turn: Any = 1) -> list[int]:
    """Fly as the arguments say."""
    return [1, turn, speed, 1]


def test_a_partial_bears_the_name_and_source_of_its_function_and_its_arguments():
    bare = FunctionPolicy(along)
    policies = [
        FunctionPolicy(functools.partial(along, *given, **named))
        for given, named in ([(0,), {}], [(1,), {}], [(0,), {"turn": 2}], [(np.zeros(2000),), {}], [(np.eye(40),), {}])
    ]
    assert {policy.name for policy in policies} == {"along"}
    assert len({policy.source for policy in (bare, *policies)}) == 6
    again = FunctionPolicy(functools.partial(functools.partial(along, 0), turn=2))
    assert again.source == policies[2].source and re.fullmatch("[0-9a-f]{16}", again.source)


def test_a_partial_may_say_more_than_its_function():
    given: Any = functools.partial(along, 0)
    given.label, given.version = "Slow", 3
    assert (FunctionPolicy(given).name, FunctionPolicy(given).version) == ("Slow", 3)


def test_a_partial_flies_as_its_function_does(easy_world: World):
    flown, wanted = (fly(each, easy_world) for each in (functools.partial(along, 0), ahead))
    assert [(row.return_, row.length) for row in flown] == [(row.return_, row.length) for row in wanted]


def test_arguments_that_no_text_names_need_a_source():
    given = functools.partial(along, object())
    with pytest.raises(ResultsError, match=r"along has the argument <object object at .*; give `source`"):
        FunctionPolicy(given)
    assert FunctionPolicy(given, source="mine").source == "mine"


def test_a_lambda_of_a_session_needs_a_name_of_its_source():
    made = eval("lambda obs: [1, 1, 1, 1]")
    with pytest.raises(ResultsError, match="the source of mine cannot be read"):
        FunctionPolicy(made, name="mine")
    assert FunctionPolicy(made, name="mine", source="weights-1").source == "weights-1"


def test_references_are_told_from_paths(tmp_path: Path):
    assert [is_reference(text) for text in ("fly.py:fly", "a.b:fly", "fly.py", "runs/a", "C:/runs/a", "hover")] == [
        True, True, False, False, False, False
    ]  # fmt: skip
    (tmp_path / "run:one").mkdir()
    assert not is_reference(str(tmp_path / "run:one"))


@pytest.mark.parametrize(("option", "unit"), [(0, 1.0), (1, 0.0), (2, -1.0)])
def test_an_option_is_the_same_move_in_continuous_actions(option: int, unit: float):
    player = player_of(
        Constant((option, option, option, option)), torch.Generator(), env=EnvConfig(action="continuous")
    )
    assert player(np.zeros((1, 0), np.float32), np.ones(1, bool)).tolist() == [[unit] * 4]
