"""Tests that recorded and replayed gradient steps equal individual ones."""

import dataclasses
from functools import partial
from typing import Any

import numpy as np
import pytest
import torch

from tests.devices.pretend import PRETEND, Device, Mixed, record
from tests.devices.test_learners import SHORT, SPACES
from tests.devices.toy import TensorWalk
from thalweg.algos import ALGORITHMS
from thalweg.algos.common.cuda_graphs import WARM, CudaGraphs
from thalweg.algos.common.state import array_of
from thalweg.algos.interface import Rollout, Task
from thalweg.train.rollouts.tensor_collector import TensorCollector
from thalweg.train.trainer import Trainer

CASES = [
    (name, space, settings)
    for name in ("DDPGLag", "TD3Lag", "SACLag")
    for space, settings in (
        ("MultiDiscrete", {"cost_limits": (0.5, 1.0), "asymmetric_critics": True}),
        ("MultiDiscrete", {"adapter": "box_scaled", "cost_limit": 0.5}),
        ("Box", {"cost_limit": 0.5, "cost_critics": 2, "asymmetric_critics": True}),
    )
]


class Telling(TensorCollector):
    """Tells critics two numbers beside the observation."""

    def rollout(self) -> Rollout:
        found = super().rollout()
        told = torch.stack([found.obs[..., 0], 10.0 * found.obs[..., 1]], -1)
        return dataclasses.replace(found, critic_obs=told, final_critic_obs=told.new_zeros(0, 2))


def trained(
    name: str, space: str, settings: dict[str, Any], asked: bool, begun: bool = False
) -> tuple[Any, list[dict[str, float]]]:
    """The learner at the end, and what it told; `begun` says that its policy was given."""
    entry = ALGORITHMS[name]
    config = entry.configure(SHORT[name] | {"updates_per_step": 0.5} | settings)
    env = TensorWalk(8, SPACES[space], PRETEND)
    collector = Telling(env, config.frame_stack, 1)
    task = Task(collector.obs_size, SPACES[space], 8, 0, {}, PRETEND, graphs=asked, critic_size=2)
    learner: Any = entry.make(config, task)
    if begun:
        learner.warm_up_critics()
    trainer, told = Trainer(collector, learner, 160, seed=0, threads=1), []
    trainer.start()
    while not trainer.done:
        trainer.step()
        if trainer.ready and (metrics := trainer.update()):
            told.append(metrics)
    return trainer.learner, told


@pytest.mark.parametrize(("name", "space", "settings"), CASES, ids=str)
@pytest.mark.slow
def test_recorded_steps_equal_individual_ones(name: str, space: str, settings: dict[str, Any], recorder: Device):
    one, other = (trained(name, space, settings, asked) for asked in (False, True))
    assert_equal(one, other)
    assert len(other[0].agent._graphs._replays) == (2 if name == "TD3Lag" else 1)
    assert one[0].agent._graphs._replays == {}


@pytest.mark.parametrize("name", ["DDPGLag", "TD3Lag", "SACLag"])
@pytest.mark.slow
def test_recorded_steps_of_critics_alone_equal_individual_ones(name: str, recorder: Device):
    """And then those of the policy too: the multiplier, a number of the recording, stays, and so the recordings."""
    still = {"critic_warmup_steps": 60, "multiplier_rate": 0.0, "multiplier_gain": 0.0, "cost_limit": 0.5}
    one, other = (trained(name, "Box", still, asked, begun=True) for asked in (False, True))
    assert_equal(one, other)
    taken = other[0].agent._graphs._replays
    assert {kind for kind, _ in taken} == {(False, True), (True, True)} | (
        {(False, False)} if name == "TD3Lag" else set()
    )


def assert_equal(one: tuple[Any, list[dict[str, float]]], other: tuple[Any, list[dict[str, float]]]) -> None:
    plain, recorded = (np.array([list(metrics.values()) for metrics in told]) for told in (one[1], other[1]))
    np.testing.assert_array_equal(plain, recorded)
    for stack in ("actor", "critics"):
        mine, theirs = (learner.agent.state()[stack] for learner in (one[0], other[0]))
        for weight, values in mine.items():
            np.testing.assert_array_equal(values, theirs[weight])


def test_a_step_is_recorded_once_per_kind_and_shape_and_again_for_other_numbers(recorder: Device):
    taken: list[tuple[int, float]] = []
    total = torch.zeros((), device=PRETEND)

    def step(rows: torch.Tensor, factor: float) -> None:
        taken.append((len(rows), factor))
        total.add_(rows.sum() * factor)

    graph = CudaGraphs(True, [])
    for factor in (1.0, 10.0):
        for rows in (2, 2, 3, 2, 2, 3, 3):
            graph.run(partial(step, factor=factor), torch.ones(rows, device=PRETEND), "kind", factor)
    assert len(taken) == 2 * WARM + 6 and float(array_of(total)) == 17.0 * 11.0
    assert taken[-3:] == [(2, 10.0), (2, 10.0), (3, 10.0)]  # the first with another number is taken as it is


@pytest.mark.parametrize("wrong", ["reads", "brings"])
def test_operations_that_involve_the_host_are_not_recorded(wrong: str, recorder: Device):
    rows = torch.ones(3, device=PRETEND)
    step = {"reads": lambda: float(rows.sum()), "brings": lambda: rows.add_(torch.ones(3).to(PRETEND))}[wrong]
    with pytest.raises(Mixed, match="can't be recorded"):
        record(recorder, step)  # pyright: ignore[reportArgumentType]
