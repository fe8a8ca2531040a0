"""Records that pass from the renderer to its kernels: settings, views, a posed camera and the buffers of a frame.

All are NamedTuples: Numba takes them as arguments and takes them apart at no cost.
"""

from typing import Any, NamedTuple

import numpy as np

LANES = 16
"""Single-precision numbers of the widest vector. Rows and lists are filled up to a multiple of this, so that loops over
them end on whole vectors."""
COLOURS, LAYERS, MASK = range(3)
"""What is drawn of a frame: its colours and its mask; depth, class and mask; or the mask alone."""


class FrameSettings(NamedTuple):
    """What all frames of a renderer share."""

    height: int
    """Rows of the image."""
    width: int
    """Columns of the image."""
    near_m: np.float32
    """Depth of the near plane."""
    reduced: bool
    """Whether the quality is the reduced one."""


class Views(NamedTuple):
    """The N frames to draw, on the host or on a device."""

    world_index: Any
    """[N] int64."""
    poses: Any
    """[N, 4] float64: x, y, z in metres, yaw in radians."""
    times: Any
    """[N] float64, seconds."""
    looks: Any
    """[N, LOOK_COLUMNS] float32."""


class PosedCamera(NamedTuple):
    """A camera at a pose, in float32: its position, its unit vectors and its image plane at distance one.

    The right vector has no z component, because the camera does not roll.
    """

    x: Any
    y: Any
    z: Any
    forward_x: Any
    forward_y: Any
    forward_z: Any
    right_x: Any
    right_y: Any
    up_x: Any
    up_y: Any
    up_z: Any
    half_w: Any
    """Half the width of the image plane."""
    half_h: Any
    """Half the height of the image plane."""
    column_step: Any
    """Width of a pixel on the image plane."""
    near_m: Any
    height: Any
    """Rows of the image, an integer."""
    width: Any
    """Columns of the image, an integer."""


class View(NamedTuple):
    """One frame to draw."""

    world: Any
    """Which of the scene's worlds the camera is in."""
    look: Any
    """[LOOK_COLUMNS] float32, see `thalweg.render.records.appearance`."""
    camera: Any
    """A `PosedCamera`."""
    time: Any
    """Seconds, float32."""


class Buffers(NamedTuple):
    """What the pixels of a frame hold, or those of some of its rows, each [H', W'], or [N, H, W] for many frames."""

    depth: Any
    """float32, metres along the optical axis to ground, water or a bridge; `MISS` where a ray meets nothing."""
    kind: Any
    """uint8, the class of what lies there, plants apart."""
    red: Any
    """float32, radiance, as the next two."""
    green: Any
    blue: Any
    transmittance: Any
    """float32, share of the light that the plants in front let through."""
    plant_depth: Any
    """float32, depth of the plant behind which less than half of the light remains; `MISS` without one."""
    water: Any
    """float32, metres of water where a ray meets ground or water, negative where it is dry; any number elsewhere."""


class Output(NamedTuple):
    """Arrays of N frames that drawing fills; [1, 1, 1] where they are not asked for."""

    drawn: Any
    """`COLOURS`, `LAYERS` or `MASK`."""
    images: Any
    """[N, H, W] uint32, with `COLOURS`: red, green, blue from the lowest byte up, and the water mask in the highest."""
    masks: Any
    """[N, H, W] uint8, with `LAYERS` and `MASK`: 255 where water is seen, else 0."""
    want_layers: Any
    """Whether the next two are filled, with `COLOURS` or `LAYERS`."""
    depths: Any
    """[N, H, W] float32, metres along the axis; -1 for the sky."""
    classes: Any
    """[N, H, W] uint8."""


def output(
    drawn: int,
    images: np.ndarray | None = None,
    masks: np.ndarray | None = None,
    layers: tuple[np.ndarray, np.ndarray] | None = None,
) -> Output:
    """Return an `Output` of the arrays that are given; layers: depths and classes."""
    # Kernels have one signature, whatever is asked for.
    images = np.empty((1, 1, 1), np.uint32) if images is None else images
    masks = np.empty((1, 1, 1), np.uint8) if masks is None else masks
    depths, classes = layers or (np.empty((1, 1, 1), np.float32), np.empty((1, 1, 1), np.uint8))
    return Output(drawn, images, masks, layers is not None, depths, classes)
