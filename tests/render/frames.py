"""Rays, poses, a bridge and a measure of likeness for tests of frames."""

import numpy as np

from thalweg.render import Camera
from thalweg.render.kernels.camera_rays import pose_camera
from thalweg.render.records.view import FrameSettings, PosedCamera
from thalweg.render.reference import frame as reference
from thalweg.world.record import World

ARCH = np.array([[0.0, 0.0, 0.3, 14.0, 3.0, 9.0, -0.2, 1.9, 2.2, 0.3, 0.5]])
"""[1, 11], one bridge with the columns of `thalweg.world.record.BRIDGE`."""


def rays(camera: Camera, yaw: float) -> np.ndarray:
    forward, right, up = reference.axes(yaw, np.radians(camera.pitch_deg))
    sy = camera.half_height * (1 - 2 * (np.arange(camera.height_px) + 0.5) / camera.height_px)
    sx = camera.half_width * (2 * (np.arange(camera.width_px) + 0.5) / camera.width_px - 1)
    return forward + sy[:, None, None] * up + sx[None, :, None] * right


def posed(pose: np.ndarray, look: np.ndarray, camera: Camera) -> PosedCamera:
    """The camera at a pose as the kernels see it: a call from Python turns its numbers into double precision."""
    settings = FrameSettings(camera.height_px, camera.width_px, np.float32(camera.near_m), False)
    *numbers, height, width = pose_camera(pose, look, settings)
    return PosedCamera._make((*(np.float32(number) for number in numbers), height, width))


def on_river(world: World, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    sample = rng.integers(0, len(world.river.arc_m), count)
    tangent = world.river.tangent[sample]
    return np.column_stack(
        [
            world.river.position_m[sample],
            world.river.level_m[sample] + rng.uniform(0.8, 9.0, count),
            np.arctan2(tangent[:, 1], tangent[:, 0]) + rng.uniform(-0.6, 0.6, count),
        ]
    )


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / np.mean((a.astype(float) - b) ** 2)))
