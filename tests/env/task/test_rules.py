"""The kernels agree with the reference implementation over random flights in hand-made and generated rivers."""

import numpy as np
import pytest

from tests.env.handmade import canal, hairpin, ring
from tests.env.reference import ReferenceEpisode
from tests.env.winding import river
from thalweg.env import DoneReason, EnvConfig, RiverVectorEnv
from thalweg.world.bridges import bridge_across


def worlds():
    bridge = bridge_across(np.array([20.0, 0.0]), np.array([1.0, 0.0]), 6.0, 0.0, np.random.default_rng(1))[None]
    island = [[35.0, 0.5, 3.0, 1.0, 0.3]]
    return [
        canal(bridges=bridge, islands=island, level_m=np.linspace(0.0, 2.0, 61)),
        hairpin(arm_m=30.0, gap_m=10.0, width_m=8.0),
        ring(radius_m=8.0, count=40, width_m=np.r_[np.linspace(3, 12, 20), np.linspace(12, 3, 20)]),
        river("Hard", 1),
        river("Medium", 2),
    ]


def compare(config: EnvConfig, envs: int, steps: int, seed: int) -> np.ndarray:
    """Compare kernels and references step by step; return the count of each done reason [8], RUNNING first."""
    env = RiverVectorEnv(worlds(), envs, config, autoreset_mode="DISABLED")
    env.reset(seed=seed)
    references = [
        ReferenceEpisode(env.worlds[w], config, pose) for w, pose in zip(env.world_index, env.state.pose, strict=True)
    ]
    rng = np.random.default_rng(seed)
    counts = np.zeros(8, dtype=int)
    for _ in range(steps):
        wild = rng.integers(0, 3, size=(envs, 4))
        actions = np.where(rng.random((envs, 1)) < 0.6, env.pilot_actions(), wild)
        _, rewards, _, _, info = env.step(actions)
        for row, reference in enumerate(references):
            reward, tight, loose, reason = reference.step(actions[row])
            assert reason == info["done_reason"][row]
            assert reward == pytest.approx(rewards[row], abs=1e-12)
            assert info["costs"][row] == pytest.approx([tight, loose])
            assert info["pose"][row] == pytest.approx([reference.x, reference.y, reference.z, reference.yaw], abs=1e-9)
            assert info["progress"][row] == len(reference.visited) / reference.river.segments
            counts[reason + 1] += 1
        ended = info["done_reason"] >= 0
        if ended.any():
            env.reset(options={"reset_mask": ended})
            for row in np.flatnonzero(ended):
                references[row] = ReferenceEpisode(env.worlds[env.world_index[row]], config, env.state.pose[row])
    return counts


def test_kernels_agree_with_the_reference():
    compare(EnvConfig(observation="none", max_idle_steps=5), envs=10, steps=250, seed=0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "config",
    [
        EnvConfig(observation="none"),
        EnvConfig(observation="none", reward_scheme="package", allow_backward=True, max_idle_steps=4, max_steps=60),
        EnvConfig(observation="none", forward_step_m=3.0, yaw_step_deg=25.0, body_m=2.0),
    ],
)
def test_kernels_agree_with_the_reference_over_many_flights(config: EnvConfig):
    counts = compare(config, envs=30, steps=500, seed=3)
    assert counts[DoneReason.COLLISION + 1 : DoneReason.YAW_OVER_DEVIATION + 2].min() > 3
