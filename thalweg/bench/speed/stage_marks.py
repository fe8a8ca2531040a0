"""The kernel that draws frames with marks of the clock between their stages.

It is compiled for `thalweg speed --stages` alone. The renderer's kernel has no marks.
"""

import platform
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from thalweg.core.jit import kernel
from thalweg.render.kernels import frame
from thalweg.render.kernels.bridge_edges import soften_edges
from thalweg.render.kernels.camera_rays import Radiance, pose_camera
from thalweg.render.kernels.plants.draw import draw_plants
from thalweg.render.kernels.shading import tone
from thalweg.render.kernels.terrain.primary_hits import find_primary_hits
from thalweg.render.records.classes import BRIDGE
from thalweg.render.records.view import COLOURS, Planes, View

f32 = np.float32
INTERVALS = {
    "ground": [(0, 1)],
    # Their stone is added to the image after the plants and the shading.
    "bridges": [(1, 2), (9, 10)],
    "plants": [(2, 3)],
    "shading: sky": [(4, 5)],
    "shading: ground": [(8, 9)],
    "shading: water": [(6, 7)],
    "edges of bridges": [(10, 11)],
    "tone": [(11, 12)],
}
"""Marks of `time_stages` between which each stage lies."""
MARKS = 13
COUNTER = "llvm.readcyclecounter" if platform.machine() in ("x86_64", "AMD64") else "llvm.readsteadycounter"
"""LLVM's clock that a program may read on this processor."""


def _ticks(typing_context):
    """Type and code of a call without arguments that reads the clock."""

    def generate(context, builder, signature, arguments):
        function = builder.module.declare_intrinsic(COUNTER, fnty=ir.FunctionType(ir.IntType(64), []))
        return builder.call(function, [])

    return types.int64(), generate


ticks: Any = intrinsic(_ticks)
"""Returns the processor's clock as an integer, in a unit of its own."""


@kernel
def time_frames(scene, views, settings, images, marks):
    """Draw N frames into images [N, H, W] uint32, and fill marks [N, MARKS] with the clock between their stages."""
    for n in range(len(marks)):
        look = views.looks[n]
        camera = pose_camera(views.poses[n], look, settings)
        view = View(views.world_index[n], look, camera, f32(views.times[n]))
        planes = frame.empty_planes(settings.height, settings.width)
        time_stages(scene, view, settings, planes, np.empty_like(planes.kind), images[n], marks[n])


@kernel
def time_stages(scene, view, settings, planes, shown, image, marks):
    """Draw one frame of full quality as `frame.draw_rows` and `frame.finish_frame` do, with marks [MARKS] of the clock.

    shown: scratch like `planes.kind`, in which one class at a time is shaded.
    """
    marks[0] = ticks()
    find_primary_hits(scene, view, 0, False, planes.depth, planes.kind)
    marks[1] = ticks()
    stone = frame.draw_bridges(scene, view, 0, COLOURS, planes.depth, planes.kind)
    marks[2] = ticks()
    draw_plants(scene, view, 0, False, planes)
    marks[3] = ticks()
    one_class = Planes(
        planes.depth, shown, planes.red, planes.green, planes.blue, planes.transmittance, planes.plant_depth
    )  # fmt: skip
    for what in range(3):
        keep_class(planes.kind, what, shown)
        marks[4 + 2 * what] = ticks()
        frame.shade(scene, view, 0, False, one_class)
        marks[5 + 2 * what] = ticks()
    frame.add_stone(stone, planes)
    marks[10] = ticks()
    soften_edges(scene, view, frame.rows_of(planes, 0, settings.height))
    marks[11] = ticks()
    frame.mask_water(planes.kind, planes.transmittance)
    radiance = Radiance(planes.red, planes.green, planes.blue)
    tone.write_image(radiance, planes.kind, view.look, frame.noise_key(view), image)
    marks[12] = ticks()


@kernel(disjoint=True, allocates=False)
def keep_class(kind, what, shown):
    """Fill `shown` with kind [H', W'], with all classes but one replaced by that of bridges, which is not shaded."""
    for r in range(kind.shape[0]):
        for c in range(kind.shape[1]):
            shown[r, c] = kind[r, c] if kind[r, c] == what else np.uint8(BRIDGE)
