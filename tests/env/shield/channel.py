"""A river for the eye: water masks of a plane of water between banks, drawn ray by ray, with decks across it."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from thalweg.env.shield.sight import Optics
from thalweg.render import Camera

Water = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass
class Channel:
    """Water where `wet` says so; the plane is z = 0."""

    wet: Water
    decks: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Lowest and highest x, lowest and highest z of each deck, which is endless along y."""
    camera: Camera = field(default_factory=Camera)

    def mask(self, pose: np.ndarray) -> np.ndarray:
        """Return the mask [H, W] uint8 seen from a pose [4]."""
        rays = rays_of(self.camera, pose)
        down = rays[..., 2] < 0
        depth = np.where(down, pose[2] / np.where(down, -rays[..., 2], 1.0), 0.0)
        x, y = pose[0] + depth * rays[..., 0], pose[1] + depth * rays[..., 1]
        water = down & self.wet(x, y)
        for low_x, high_x, low_z, high_z in self.decks:
            # Shares of the way to the plane at which the ray is between the heights, and between the ends, of the deck.
            along = np.where(np.abs(x - pose[0]) < 1e-9, 1e-9, x - pose[0])
            ends = np.sort(np.stack([(low_x - pose[0]) / along, (high_x - pose[0]) / along]), axis=0)
            first = np.maximum(ends[0], max(1 - high_z / pose[2], 0.0))
            last = np.minimum(ends[1], 1 - low_z / pose[2])
            water &= ~(first < last)
        return np.where(water, 255, 0).astype(np.uint8)


def rays_of(camera: Camera, pose: np.ndarray) -> np.ndarray:
    """Return the rays [H, W, 3] through the pixels of a camera at a pose [4], in metres per metre of depth."""
    yaw, pitch = pose[3], np.radians(camera.pitch_deg)
    ahead, right = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    forward = np.cos(pitch) * ahead - np.array([0.0, 0.0, np.sin(pitch)])
    up = np.sin(pitch) * ahead + np.array([0.0, 0.0, np.cos(pitch)])
    rows, columns = np.meshgrid(np.arange(camera.height_px), np.arange(camera.width_px), indexing="ij")
    x = (columns + 0.5) * camera.pixel - camera.half_width
    y = camera.half_height - (rows + 0.5) * camera.pixel
    return forward + y[..., None] * up + x[..., None] * right


def straight(half_width: float) -> Water:
    """Water along x, around y = 0."""
    return lambda x, y: np.abs(y) < half_width


def optics_of(camera: Camera) -> Optics:
    """Return what the shield takes a camera to be."""
    half_w = camera.half_height * camera.width_px / camera.height_px
    return Optics(*(np.array([value]) for value in (np.radians(camera.pitch_deg), half_w, camera.half_height)))
