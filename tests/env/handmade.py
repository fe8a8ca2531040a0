"""Small courses made by hand for the tests of the rules, and a renderer that draws almost nothing."""

from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from thalweg.world.record import Grid, Plants, River, World


def world_of(
    points: ArrayLike,
    closed: bool = True,
    *,
    width_m: ArrayLike = 6.0,
    level_m: ArrayLike = 0.0,
    islands: ArrayLike | None = None,
    bridges: ArrayLike | None = None,
    name: str = "handmade",
) -> World:
    """A world whose river runs through points [S, 2] as they are; only what the rules read is filled in."""
    position = np.asarray(points, dtype=np.float64)
    count = len(position)
    steps = np.roll(position, -1, axis=0) - position
    if not closed:
        steps[-1] = steps[-2]
    lengths = np.linalg.norm(steps, axis=1)
    ahead = steps / lengths[:, None]
    before = np.roll(ahead, 1, axis=0)
    if not closed:
        before[0] = ahead[0]
    tangent = ahead + before
    river = River(
        closed=closed,
        position_m=position,
        arc_m=np.concatenate([[0.0], np.cumsum(lengths[:-1])]),
        length_m=float(lengths.sum() if closed else lengths[:-1].sum()),
        tangent=tangent / np.linalg.norm(tangent, axis=1, keepdims=True),
        width_m=np.broadcast_to(np.asarray(width_m, dtype=np.float64), count).copy(),
        depth_m=np.ones(count),
        level_m=np.broadcast_to(np.asarray(level_m, dtype=np.float64), count).copy(),
    )
    maps = np.zeros((2, 2), np.float32)
    codes = np.zeros((2, 2), np.uint8)
    none = np.zeros(0, np.float32)
    return World(
        name=name,
        seed=0,
        river=river,
        islands=np.zeros((0, 5)) if islands is None else np.asarray(islands, dtype=np.float64).reshape(-1, 5),
        bridges=np.zeros((0, 11)) if bridges is None else np.asarray(bridges, dtype=np.float64).reshape(-1, 11),
        grid=Grid(0.0, 0.0, 1.0),
        ground_m=maps,
        water_m=maps,
        albedo=np.zeros((2, 2, 3), np.uint8),
        sun=codes,
        sky=codes,
        canopy_m=maps,
        plants=Plants(
            np.zeros((0, 3), np.float32), none, none, none.astype(np.int16), none, np.zeros((0, 3), np.float32),
            np.zeros((0, 2), np.float32),
        ),
        sun_azimuth=0.0,
        sun_elevation=1.0,
    )  # fmt: skip


def ring(radius_m: float = 20.0, count: int = 96, **options) -> World:
    """A circular course, counter-clockwise round the origin, that begins at (radius, 0)."""
    angle = 2.0 * np.pi * np.arange(count) / count
    return world_of(radius_m * np.column_stack([np.cos(angle), np.sin(angle)]), **options)


def canal(length_m: float = 60.0, spacing_m: float = 1.0, **options) -> World:
    """A straight open course along x that begins at the origin."""
    x = np.arange(0.0, length_m + 1e-9, spacing_m)
    return world_of(np.column_stack([x, np.zeros_like(x)]), closed=False, **options)


def hairpin(arm_m: float = 30.0, gap_m: float = 10.0, **options) -> World:
    """Two long parallel arms, at y = 0 and y = gap, joined by half circles at both ends; a closed course."""
    radius = gap_m / 2.0
    x = np.arange(0.0, arm_m, 1.0)
    turn = np.linspace(0.0, np.pi, 17)[:-1]
    there = np.column_stack([x, np.zeros_like(x)])
    bend = np.column_stack([arm_m + radius * np.sin(turn), radius - radius * np.cos(turn)])
    back = np.column_stack([arm_m - x, np.full_like(x, gap_m)])
    close = np.column_stack([-radius * np.sin(turn), radius + radius * np.cos(turn)])
    return world_of(np.concatenate([there, bend, back, close]), **options)


class BlankMaskRenderer:
    """Masks that hold the pose in their first pixels, and frames of nothing; counts the calls of each."""

    def __init__(self) -> None:
        self.camera = SimpleNamespace(height_px=8, width_px=8)
        self.mask_calls = self.frame_calls = 0

    def render_mask(self, poses, world_index=None, out=None, look=None):
        """Masks [N, H, W] uint8."""
        self.mask_calls += 1
        masks = np.zeros((len(poses), 8, 8), np.uint8)
        masks[:, 0, :4] = np.mod(np.asarray(poses) * 16.0, 256.0).astype(np.uint8)
        return masks

    def render(self, poses, world_index=None, time_s=None, out=None):
        """Frames [N, H, W, 4] uint8, all 7."""
        self.frame_calls += 1
        return np.full((len(poses), 8, 8, 4), 7, np.uint8)


class BlankRenderer:
    """Frames that hold the pose and the world's number in their first pixels, so that tests see what was drawn."""

    def __init__(self, height_px: int = 8, width_px: int = 8) -> None:
        self.camera = SimpleNamespace(height_px=height_px, width_px=width_px)
        self.calls: list[int] = []
        self.props: np.ndarray | None = None
        """Objects of the last call."""

    def render_tensors(self, views, out, props=None):
        """The same of tensors: world_index, poses, times and looks."""
        world_index, poses, times = (tensor.numpy() for tensor in views[:3])
        frames = self.render(poses, world_index, times, props=None if props is None else props.numpy())
        out.numpy()[...] = frames[..., 3:] if out.shape[-1] == 1 else frames

    def render(self, poses, world_index=None, time_s=None, out=None, props=None):
        """Frames [N, H, W, 4] uint8."""
        self.props = props
        self.calls.append(len(poses))
        if out is None:
            out = np.empty((len(poses), self.camera.height_px, self.camera.width_px, 4), np.uint8)
        out[...] = 0
        out[..., 3] = 255
        out[:, 0, :4, 0] = np.mod(np.asarray(poses) * 16.0, 256.0).astype(np.uint8)
        out[:, 1, 0, 0] = 0 if world_index is None else world_index
        out[:, 1, 1, 0] = 0 if time_s is None else np.mod(np.asarray(time_s) * 4.0, 256.0).astype(np.uint8)
        return out
