"""The boat's pilot: rivers of each level at no cost, past shoals, rocks and bridges."""

import numpy as np
import pytest

from tests.env.vehicle.basins import arch_at, basin
from thalweg.env import DoneReason, EnvConfig, RiverVectorEnv
from thalweg.env.rivers.sounded_river import load_or_sound
from thalweg.world import World, level_named

CONFIG = EnvConfig(vehicle="asv", observation="none")


def voyages(
    worlds: list[World], starts: int, poses: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns, costs and reasons of the pilot's first episodes, one after another in the worlds."""
    env = RiverVectorEnv(worlds, starts * len(worlds), CONFIG, autoreset_mode="next_step")
    env.reset(seed=0, options=None if poses is None else {"pose": poses})
    returns, costs = np.zeros(env.num_envs), np.zeros(env.num_envs)
    reasons = np.full(env.num_envs, -1)
    while (reasons < 0).any():
        running = reasons < 0
        _, reward, _, _, info = env.step(env.pilot_actions())
        returns[running] += reward[running]
        costs[running] += info["cost"][running]
        reasons[running] = info["done_reason"][running]
    return returns, costs, reasons


def test_it_takes_its_way_round_shoals_rocks_and_below_a_bridge():
    world = basin(
        lambda x, y: np.where((np.abs(x - 22.0) < 3.0) & (y > -1.5), 0.1, 1.5),
        rocks=((40.0, 1.0, 1.0),),
        bridges=arch_at(50.0, 10.0),
        length_m=70.0,
    )
    _, costs, reasons = voyages([world], 4, np.array([[4.0, y, 0.0, 0.0] for y in (-3.0, -1.0, 1.0, 3.0)]))
    assert costs.tolist() == [0.0] * 4 and (reasons == DoneReason.SUCCESS).all()


def test_it_pays_for_a_ford_where_there_is_no_way_round():
    world = basin(lambda x, y: np.where(np.abs(x - 20.0) < 2.0, 0.37, 1.5), length_m=40.0)
    _, costs, reasons = voyages([world], 1, np.array([[4.0, 0.0, 0.0, 0.0]]))
    assert reasons[0] == DoneReason.SUCCESS and 0.5 < costs[0] < 5.0


@pytest.mark.slow
@pytest.mark.parametrize("level", ["Easy", "Medium-Deep", "Hard-Deep"])
def test_it_earns_all_there_is_at_no_cost(level: str):
    worlds = [load_or_sound(level_named(level), seed) for seed in range(3000, 3003)]
    returns, costs, _ = voyages(worlds, 2)
    assert returns == pytest.approx(np.full(6, 10.0)) and costs.tolist() == [0.0] * 6
