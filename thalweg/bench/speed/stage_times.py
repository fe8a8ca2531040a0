"""The kernel that draws frames and reads the clock between their stages.

It is compiled for `thalweg speed --stages` alone. The renderer's kernel reads no clock.
"""

import platform
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels import frame
from thalweg.render.kernels.bridge_edges import soften_edges
from thalweg.render.kernels.camera_rays import Radiance, pose_camera
from thalweg.render.kernels.plants.draw import draw_plants
from thalweg.render.kernels.shading import background, tone
from thalweg.render.kernels.terrain.primary_hits import find_primary_hits
from thalweg.render.records.view import COLOURS, View

f32 = np.float32
TIMED_STAGES = (
    "ground",
    "bridges",
    "plants",
    "shading: gathering",
    "shading: sky",
    "shading: water",
    "shading: ground",
    "edges of bridges",
    "tone",
)
"""Stages of a frame in the order of `time_stages`."""
GROUND, BRIDGES, PLANTS, GATHERING, SKY, WATER, SHADED_GROUND, EDGES, TONE = range(len(TIMED_STAGES))
"""Their numbers."""
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
def time_frames(scene, views, settings, images, spent):
    """Draw N frames into images [N, H, W] uint32, and fill spent [N, stages + 1] with the ticks of the clock in each of
    `TIMED_STAGES`, and last with those of the whole frame."""
    for n in range(len(spent)):
        look = views.looks[n]
        camera = pose_camera(views.poses[n], look, settings)
        view = View(views.world_index[n], look, camera, f32(views.times[n]))
        start = ticks()
        buffers = frame.empty_buffers(settings.height, settings.width, COLOURS)
        time_stages(scene, view, settings, buffers, images[n], spent[n])
        spent[n, len(TIMED_STAGES)] = ticks() - start


@kernel
def time_stages(scene, view, settings, buffers, image, spent):
    """Draw one frame of full quality as `frame.draw_rows` and `frame.finish_frame` do, and fill spent [stages]."""
    wide = buffers.depth.shape[1]
    t0 = ticks()
    find_primary_hits(scene, view, 0, False, buffers.depth, buffers.kind, buffers.water)
    t1 = ticks()
    stone = frame.draw_bridges(scene, view, 0, COLOURS, buffers.depth, buffers.kind)
    t2 = ticks()
    draw_plants(scene, view, 0, False, buffers)
    t3 = ticks()
    spent[GROUND] = t1 - t0
    spent[PLANTS] = t3 - t2
    time_shading(scene, view, background.flattened(buffers), wide, background.empty_gathered(wide), spent)
    t4 = ticks()
    frame.add_stone(stone, buffers)
    t5 = ticks()
    # Their stone is added to the image after the plants and the shading.
    spent[BRIDGES] = t2 - t1 + t5 - t4
    soften_edges(scene, view, frame.rows_of(buffers, 0, settings.height))
    t6 = ticks()
    frame.mask_water(buffers.kind, buffers.transmittance)
    radiance = Radiance(buffers.red, buffers.green, buffers.blue)
    tone.write_image(radiance, buffers.kind, view.look, frame.noise_key(view), image)
    spent[EDGES] = t6 - t5
    spent[TONE] = ticks() - t6


@kernel(allocates=False)
def time_shading(scene, view, buffers, wide, gathered, spent):
    """Shade as `background.shade_bands` does, and fill spent [stages] from `GATHERING` to `SHADED_GROUND`."""
    for stage in range(GATHERING, SHADED_GROUND + 1):
        spent[stage] = 0
    for first in range(0, len(buffers.depth), background.ROWS_TOGETHER * wide):
        band = background.band_of(buffers, first, wide)
        row = first // wide
        before = ticks()
        counts = background.gather(scene, view, row, False, band, wide, gathered)
        after = ticks()
        spent[GATHERING] += after - before
        for what in range(background.KINDS):
            before = after
            background.shade_kind(scene, view, row, False, what, counts[what], band, wide, gathered)
            after = ticks()
            # Classes are numbered in the order of their stages.
            spent[SKY + what] += after - before
