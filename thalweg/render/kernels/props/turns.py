"""Rotations of the parts of props."""

import math
from typing import Any, NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.props import models

f32 = np.float32


class Turn(NamedTuple):
    """A rotation: what it makes of the unit vectors along x, y and z, one after another."""

    xx: Any
    xy: Any
    xz: Any
    yx: Any
    yy: Any
    yz: Any
    zx: Any
    zy: Any
    zz: Any


@kernel(inlined=True, allocates=False)
def turn_of(yaw, pitch, roll):
    """Return the `Turn` by roll about x, then pitch about y (positive: down ahead), then yaw about z, in radians."""
    cy, sy = f32(math.cos(yaw)), f32(math.sin(yaw))
    cp, sp = f32(math.cos(pitch)), f32(math.sin(pitch))
    cr, sr = f32(math.cos(roll)), f32(math.sin(roll))
    return Turn(
        cy * cp, sy * cp, -sp,
        cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr,
        cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr,
    )  # fmt: skip


@kernel(inlined=True, allocates=False)
def turned(turn, x, y, z):
    """Return a vector after a `Turn`."""
    return (
        turn.xx * x + turn.yx * y + turn.zx * z,
        turn.xy * x + turn.yy * y + turn.zy * z,
        turn.xz * x + turn.yz * y + turn.zz * z,
    )


@kernel(inlined=True, allocates=False)
def joined(outer, inner):
    """Return the `Turn` by an inner one and then by an outer one."""
    xx, xy, xz = turned(outer, inner.xx, inner.xy, inner.xz)
    yx, yy, yz = turned(outer, inner.yx, inner.yy, inner.yz)
    zx, zy, zz = turned(outer, inner.zx, inner.zy, inner.zz)
    return Turn(xx, xy, xz, yx, yy, yz, zx, zy, zz)


@kernel(inlined=True, allocates=False)
def joint_turn(joint, phase):
    """Return the `Turn` of a joint at a phase in radians."""
    yaw, pitch, roll = f32(0), f32(0), f32(0)
    if joint == f32(models.LEFT_ARM):
        # The hand goes over the water to the front, and back under it.
        pitch = phase
    elif joint == f32(models.RIGHT_ARM):
        pitch = phase + f32(math.pi)
    elif joint == f32(models.PADDLE):
        yaw = f32(0.45) * f32(math.sin(phase))
        roll = f32(0.55) * f32(math.cos(phase))
    return turn_of(yaw, pitch, roll)
