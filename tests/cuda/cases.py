"""Worlds, poses, looks and flights for comparisons of GPU and CPU, small enough for the simulator."""

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from tests.env.vehicle.basins import arch_at, basin
from tests.render.plain import plane, plants_at
from thalweg.env import EnvConfig
from thalweg.env.physics.wind import Wind
from thalweg.env.torch_env import TensorRiverEnv
from thalweg.render import Camera, Look
from thalweg.render.records.props import PropKind
from thalweg.world.banks import QUAY_FALL, QUAY_WALL_M, quay_slope, read_banks
from thalweg.world.record import World

CAMERA = Camera(16, 16)
SIDE = 8
"""Width and height of the simulator's frames, in pixels."""


def world() -> World:
    """Sloping ground that falls below the water, an arch bridge, and one plant of each form."""
    bridges = np.array([[4.0, -3.0, 0.4, 12.0, 3.0, 8.0, 0.3, 1.9, 2.9, 0.3, 0.6]])
    places = [(float(x), float(y)) for x in (-4, 3, 9, 16) for y in (-7, -2, 4, 8)]
    return plane(slope_x=-0.03, water_level=0.0, bridges=bridges, plants=_mixed(places))


def worlds() -> list[World]:
    """That one, and one of nothing but ground and water."""
    return [world(), plane(slope_y=0.04, water_level=0.5)]


def drawn_worlds() -> list[World]:
    """Both, and a quay across the view: a wall as steep as on a map with nodes half a metre apart, and its pavement."""
    plain = plane(water_level=0.0)
    x = np.arange(plain.ground_m.shape[1]) * plain.grid.cell_m + plain.grid.origin_x_m
    ground = np.minimum(quay_slope(plain.grid.cell_m) * x, QUAY_WALL_M + QUAY_FALL * np.maximum(x - 1.0, 0.0))
    ground = np.broadcast_to(np.maximum(ground, -1.0), plain.ground_m.shape)
    return [*worlds(), replace(plain, ground_m=ground.astype(np.float32), banks=read_banks("quay"))]


FLIGHTS, STEPS = 5, 60


def flown(task: Any = "River") -> dict[str, np.ndarray]:
    """What happens to environments of tensors in all steps of random flights, and what they see and feel of it."""
    config = EnvConfig(observation=("proprioception", "privileged"), max_idle_steps=8, task=task)
    env = TensorRiverEnv(worlds(), FLIGHTS, config, device="cpu")
    env.reset(seed=0)
    chosen = torch.randint(0, 3, (STEPS, FLIGHTS, 4), generator=torch.Generator().manual_seed(0))
    steps = [env.step(actions) for actions in chosen]
    return {
        "seen": np.array([obs["privileged"].numpy() for obs, *_ in steps]),
        "felt": np.array([obs["proprioception"].numpy() for obs, *_ in steps]),
        "pose": np.array([info["pose"].numpy() for *_, info in steps]),
        "reward": np.array([reward.numpy() for _, reward, *_ in steps]),
        "costs": np.array([info["costs"].numpy() for *_, info in steps]),
        "reason": np.array([info["done_reason"].numpy() for *_, info in steps]),
    }


def flown_in_wind() -> dict[str, np.ndarray]:
    """What happens to environments of tensors in all steps of random flights under wind, current and inertia."""
    forces = {"dynamics": "inertial", "wind": Wind(), "current_m_per_s": (0.2, 0.6), "carried_by_current": True}
    config = EnvConfig(observation="none", action="continuous", max_idle_steps=8, **forces)
    env = TensorRiverEnv(worlds(), FLIGHTS, config, device="cpu")
    env.reset(seed=0)
    chosen = torch.rand(STEPS // 2, FLIGHTS, 4, generator=torch.Generator().manual_seed(0)) * 2 - 1
    infos = [env.step(actions)[-1] for actions in chosen]
    return {name: np.array([info[name].numpy() for info in infos]) for name in ("pose", "wind", "velocity", "costs")}


def flown_by_boats(windy: bool) -> dict[str, np.ndarray]:
    """What happens to boats in a basin with shoals, rocks and a bridge, and what they see of it; under wind, current
    and inertia if `windy`."""
    world = basin(
        lambda x, y: 0.6 - 0.06 * np.abs(y), rocks=((20.0, 1.0, 0.7), (40.0, -2.0, 0.5)), bridges=arch_at(30.0, 10.0)
    )
    forces: dict[str, Any] = {"dynamics": "inertial", "wind": Wind(), "current_m_per_s": (0.2, 0.6)} if windy else {}
    config = EnvConfig(observation="privileged", vehicle="asv", action="continuous", max_idle_steps=8, **forces)
    env = TensorRiverEnv([world], FLIGHTS, config, device="cpu")
    env.reset(seed=0)
    chosen = torch.rand(STEPS // 2, FLIGHTS, 4, generator=torch.Generator().manual_seed(0)) * 2 - 1
    chosen[..., 2] = 1.0  # ahead, so that there is something to hit
    steps = [env.step(actions) for actions in chosen]
    names = "pose", "costs", "done_reason", *(("wind", "velocity") if windy else ())
    found = {name: np.array([info[name].numpy() for *_, info in steps]) for name in names}
    return found | {"seen": np.array([obs.numpy() for obs, *_ in steps])}


def _mixed(places):
    plants = plants_at(places, 0, 4.0, 2.5)
    plants.kind[:] = np.arange(len(places)) * 3 % 20
    plants.light[:, 0] = 0.3
    return plants


POSES = np.array(
    [
        [-16.0, 0.0, 4.0, 0.1], [-4.0, -9.0, 2.6, 0.75], [12.0, -12.0, 6.0, 1.7], [3.0, 4.0, 5.0, -2.0],
        [-0.6, 1.0, 1.6, 0.2],
    ]
)  # fmt: skip
WORLD_INDEX = np.array([0, 0, 0, 1, 2])
PROPS = np.array(
    [
        [[PropKind.BUOY, -9.0, 0.5, 0.0, 0.0, 0.3], [PropKind.KAYAK, 5.0, 1.5, 0.0, 1.0, 2.0]],
        [[PropKind.KAYAK, 1.5, -4.0, 0.0, 0.2, 1.0], [PropKind.SWIMMER, 0.5, -5.5, 0.0, 2.0, 0.5]],
        [[PropKind.STATION, 9.0, -3.0, 0.0, 0.4, 0.0], [PropKind.BUOY, 11.0, -4.0, 0.0, 0.0, 1.0]],
        [[PropKind.NONE, 0.0, 0.0, 0.0, 0.0, 0.0], [PropKind.KAYAK, 0.5, -1.5, 0.5, 0.5, 4.0]],
        [[PropKind.NONE, 0.0, 0.0, 0.0, 0.0, 0.0], [PropKind.BUOY, 2.0, 1.5, 1.2, 0.5, 4.0]],
    ],
    np.float32,
)
"""[5, 2, 6], some of each kind in front of the cameras."""
A_PASS = 3
"""Number of cameras in a pass, so that there are two passes."""
TIMES = np.array([0.0, 3.5, 8.25, 1.0, 2.0])
LOOKS = [
    Look(),
    Look(haze=20.0, warmth=0.7, water_tint=-0.8, turbidity=0.5, ripple=1.7, season=0.8, plant_density=0.6),
    Look(exposure_ev=0.6, pitch_deg=-8.0, fov_deg=20.0, noise=5.0, turbidity=3.0),
    Look(),
    Look(),
]
