"""Files of single frames: colours, water mask, depth and class as PNG, and a table of the poses."""

from pathlib import Path

import numpy as np
from PIL import Image

from thalweg.core.atomic_io import write_atomic, write_picture
from thalweg.render.renderer import Frame

POSES = "poses.csv"
"""Name of the table of poses."""
DEPTH_PER_M = 100.0
"""Units of stored depths in a metre: they are centimetres, of 16 bits."""
FARTHEST = 65_534
"""Greatest stored depth in centimetres; what is farther is stored as this."""
SKY = 65_535
"""Stored depth of the sky."""


def write_frames(folder: Path, frames: np.ndarray, layers: Frame | None = None) -> None:
    """Write frames uint8 [N, H, W, 4] to a folder, which is created if missing.

    Frame 0 becomes 0000.png (colours) and 0000-mask.png (0 or 255); with `layers`, their depths and classes, also
    0000-depth.png (16 bits, see `depth_pixels`) and 0000-class.png (`thalweg.render.records.classes.CLASSES`).
    """
    for index, frame in enumerate(frames):
        pictures = {"": np.ascontiguousarray(frame[..., :3]), "-mask": np.ascontiguousarray(frame[..., 3])}
        if layers is not None:
            pictures |= {"-depth": depth_pixels(layers.depth_m[index]), "-class": layers.class_id[index]}
        for name, pixels in pictures.items():
            write_picture(folder / f"{index:04}{name}.png", Image.fromarray(pixels))


def depth_pixels(depth_m: np.ndarray) -> np.ndarray:
    """Return depths [H, W] in metres as centimetres uint16; `SKY` for the sky, whose depth is negative."""
    return np.where(depth_m < 0, SKY, np.rint(np.minimum(depth_m * DEPTH_PER_M, FARTHEST))).astype(np.uint16)


def write_poses(folder: Path, poses: np.ndarray) -> None:
    """Write the table of the poses [N, 4] of frames: index, x, y, z in metres, yaw in radians."""
    rows = [f"{index},{','.join(repr(float(value)) for value in pose)}" for index, pose in enumerate(poses)]
    write_atomic(folder / POSES, "\n".join(["frame,x,y,z,yaw", *rows, ""]))
