"""Tests that environments refuse anything but worlds and a config, whoever makes them."""

from typing import Any

import pytest

import thalweg
from tests.env.handmade import canal, ring
from thalweg.env import ConfigError, EnvConfig, RiverEnv, RiverVectorEnv
from thalweg.env.factory import make_single, make_vector
from thalweg.env.given import worlds_of
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.torch_env import TensorRiverEnv
from thalweg.world.levels import level_named

NONE = EnvConfig(observation="none")
NO_WORLDS = [
    ("Easy", "not str 'Easy'"),
    ([canal(), "Easy"], "not str 'Easy'"),
    ([], "must hold at least one river"),
    (3, "not int"),
]


@pytest.mark.parametrize(
    "make",
    [
        lambda given: RiverVectorEnv(given, 2, NONE),
        lambda given: TensorRiverEnv(given, 2, NONE, device="cpu"),
        lambda given: make_vector("Easy", 2, worlds=given, config=NONE),
        lambda given: thalweg.make_torch("Easy", 2, worlds=given, config=NONE, device="cpu"),
    ],
    ids=["vector", "tensors", "make_vec", "make_torch"],
)
@pytest.mark.parametrize(("given", "message"), NO_WORLDS)
def test_what_is_no_world_is_refused(make: Any, given: Any, message: str):
    with pytest.raises(ConfigError, match=message):
        make(given)


@pytest.mark.parametrize("given", ["Easy", [canal()], 3])
def test_one_environment_has_one_world(given: Any):
    with pytest.raises(ConfigError, match=r"must be a thalweg\.world\.World"):
        make_single("Easy", world=given, config=NONE)


@pytest.mark.parametrize("config", [{"observation": "none"}, "none", None])
@pytest.mark.parametrize(
    "make",
    [
        lambda config: RiverEnv(canal(), config),
        lambda config: RiverVectorEnv(canal(), 2, config),
        lambda config: TensorRiverEnv(canal(), 2, config, device="cpu"),
        lambda config: make_vector("Easy", 2, worlds=canal(), config=config),
    ],
    ids=["single", "vector", "tensors", "make_vec"],
)
def test_what_is_no_config_is_refused(make: Any, config: Any):
    with pytest.raises(ConfigError, match=f"config must be an EnvConfig, not {type(config).__name__}"):
        make(config)


def test_one_world_and_several_become_a_tuple():
    one, other = canal(), ring()
    assert worlds_of(one) == (one,) and worlds_of(iter([one, other])) == (one, other)


@pytest.mark.parametrize("entry", ["Easy", ("Easy", 3), (level_named("Easy"), 3, 4), level_named("Easy"), 3])
def test_a_list_of_rivers_refuses_what_is_none(entry: Any):
    with pytest.raises(
        ConfigError, match=r"must be a World, or a Level and a seed.*: give names .* RiverList.of_levels"
    ):
        RiverList([canal(), entry])


def test_seeds_of_a_list_of_rivers_are_whole_numbers():
    with pytest.raises(ConfigError, match=r"the seed of a river must be a whole number of at least 0, not 1\.5"):
        RiverList([(level_named("Easy"), 1.5)])  # pyright: ignore[reportArgumentType]
