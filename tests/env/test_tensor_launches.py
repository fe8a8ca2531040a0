"""Launches of environments of tensors, by a card that the host plays: they are given what the CPU's loops are."""

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from thalweg.core.compute import gpu, launch_graphs
from thalweg.env import EnvConfig
from thalweg.env.device import cuda_step
from thalweg.env.device.pushed_step import advance_pushed_all
from thalweg.env.device.step import advance_all
from thalweg.env.device.unit_actions import tensor_unit_actions
from thalweg.env.forces.of_many import write_winds
from thalweg.env.physics.wind import Wind
from thalweg.env.task.ideal_eye import see_all
from thalweg.env.task.priced.eye import see_all_in_task
from thalweg.env.task.priced.props import all_props
from thalweg.env.task.proprioception import feel_all
from thalweg.env.torch_env import TensorRiverEnv
from thalweg.env.vehicle.boat_eye import see_boats
from thalweg.world import World

ON_THE_HOST = {
    cuda_step.advance: advance_all,
    cuda_step.advance_boats: advance_all,
    cuda_step.advance_pushed: advance_pushed_all,
    cuda_step.advance_pushed_boats: advance_pushed_all,
    cuda_step.write_winds: write_winds,
    cuda_step.see: see_all,
    cuda_step.see_boats: see_boats,
    cuda_step.see_in_task: see_all_in_task,
    cuda_step.props: all_props,
    cuda_step.feel: feel_all,
}


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the kernels as they are launched, in place of recorded or replayed."""
    names = []

    def launch(kernel: Callable, blocks: int, threads: int, device: Any, *arguments: Any, fastmath: bool) -> None:
        assert blocks * threads >= len(arguments[-1]) and not fastmath
        names.append(kernel.__name__)
        ON_THE_HOST[kernel](*arguments)

    def record(launches: Callable[[], None], device: Any) -> Callable[[], None]:
        launches()
        return launches

    monkeypatch.setattr(gpu, "launch", launch)
    monkeypatch.setattr(gpu, "as_kernel_array", lambda tensor: tensor.numpy())
    monkeypatch.setattr(launch_graphs, "record_launches", record)
    monkeypatch.setattr(launch_graphs, "caller_records", lambda device: False)
    return names


WINDY: dict[str, Any] = {"action": "continuous", "dynamics": "inertial", "wind": Wind()}


@pytest.mark.parametrize(
    ("options", "kernels"),
    [
        ({}, ["advance", "feel", "see"]),
        ({"task": "Swimmers"}, ["advance", "feel", "see_in_task"]),
        ({"vehicle": "asv"}, ["advance_boats", "feel", "see", "see_boats"]),
        (WINDY, ["advance_pushed", "feel", "see", "write_winds"]),
        ({"vehicle": "asv"} | WINDY, ["advance_pushed_boats", "feel", "see", "see_boats", "write_winds"]),
    ],
    ids=["River", "Swimmers", "boats", "wind", "boats in wind"],
)
def test_launched_steps_equal_those_of_the_cpu(
    easy_world: World, launched: list[str], options: dict[str, Any], kernels: list[str]
):
    config = EnvConfig(observation=("proprioception", "privileged"), **options)
    here, there = (TensorRiverEnv(easy_world, 5, config, device="cpu") for _ in range(2))
    for env in (here, there):
        env.reset(seed=3)
    assert there._actions.shape == (5, 4)  # allocated before the device is replaced
    there.device = there._launcher.device = SimpleNamespace(type="cuda")  # pyright: ignore[reportAttributeAccessIssue]
    there._unit_actions = partial(tensor_unit_actions, config.action, count=5, fast_ratio=config.fast_ratio)
    for step in range(40):
        actions = torch.randint(0, 3, (5, 4), generator=torch.Generator().manual_seed(step))
        actions -= int(config.action == "continuous")
        (seen, reward, *_, info), (seen_there, reward_there, *_, info_there) = here.step(actions), there.step(actions)
        assert all(torch.equal(seen[part], seen_there[part]) for part in config.parts)
        assert torch.equal(reward, reward_there)
        assert all(torch.equal(info[name], info_there[name]) for name in info)
    assert launched == kernels * 40
