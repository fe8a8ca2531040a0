"""Tests that training finds the attributes of environments also in Gymnasium's vectors of single ones."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv, VectorEnv, VectorWrapper

from tests.env.handmade import ring
from tests.train.toys import Count, ToldCount
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.config import REASON_NAMES
from thalweg.env.env import RiverEnv
from thalweg.train.rollouts.collector import done_reason_names
from thalweg.train.rollouts.critic_info import critic_size
from thalweg.train.rollouts.env_attributes import env_attribute
from thalweg.train.rollouts.env_stepper import EnvStepper

SWIMMERS = EnvConfig(task="Swimmers", observation="privileged")


@pytest.fixture(params=[SyncVectorEnv, AsyncVectorEnv])
def vector_of(request) -> Iterator[Callable[[Callable[[], Any]], VectorEnv]]:
    """Makes two environments of one kind, in this process or each in its own."""
    made = []

    def make(maker: Callable[[], Any]) -> VectorEnv:
        made.append(request.param([maker] * 2))
        return made[-1]

    yield make
    for env in made:
        env.close()


@pytest.mark.parametrize("wrapped", [False, True], ids=["bare", "wrapped"])
def test_costs_of_all_kinds_are_read_and_reasons_have_names(vector_of: Callable, wrapped: bool):
    env = vector_of(lambda: RiverEnv(ring(), SWIMMERS))
    stepper = EnvStepper(VectorWrapper(env) if wrapped else env)
    native = EnvStepper(RiverVectorEnv(ring(), 2, SWIMMERS, autoreset_mode="next_step"))
    assert np.array_equal(stepper.reset(5), native.reset(5))
    for action in ([0, 1, 2, 1], [1, 1, 2, 1]):
        ours, theirs = (each.step(np.array([action] * 2)) for each in (stepper, native))
        assert ours.costs is not None and theirs.costs is not None and ours.costs.shape == (2, 3)
        assert np.array_equal(ours.costs, theirs.costs)
    assert done_reason_names(stepper.env) == done_reason_names(native.env) == REASON_NAMES


def test_an_environment_without_an_attribute_goes_on(vector_of: Callable):
    env = vector_of(Count)
    assert env_attribute(env, "cost_kinds", "none") == "none" and done_reason_names(env) == {}
    assert env.reset()[0].tolist() == [[0.0, 0.0]] * 2


def test_a_vectors_own_attribute_comes_first(vector_of: Callable):
    env = vector_of(lambda: RiverEnv(ring(), SWIMMERS))
    env.cost_kinds = ("own",)
    assert env_attribute(env, "cost_kinds") == ("own",)


def test_what_critics_are_told_is_announced(vector_of: Callable):
    assert critic_size(vector_of(ToldCount)) == 3 and critic_size(vector_of(Count)) == 0
