"""The GPU kernel that draws one pixel a thread, from the same functions as the CPU, with spans of one ray.

A block of threads draws a tile of `TILE` pixels a side: first what each ray meets of the scene, then the props before
it, then the plants before both, and last the colours of what can still be seen behind them.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import cuda, float32, uint32

from thalweg.render.gpu.pixel_records import empty_radiance, empty_rays
from thalweg.render.gpu.plant_pixels import blend_plants
from thalweg.render.gpu.prop_pixels import is_stirred, meet_props_at_pixel, shade_stirred_at_pixel, touch_props
from thalweg.render.gpu.scene_hits import nearest_bridge, primary_hit
from thalweg.render.gpu.scene_shading import shade_background
from thalweg.render.gpu.tile import WORDS
from thalweg.render.gpu.visible_plants import stored_camera
from thalweg.render.kernels.plants import billboard, reduced_billboard
from thalweg.render.kernels.shading.background import SEEN
from thalweg.render.kernels.terrain.heightfield_march import TILE
from thalweg.render.records import classes
from thalweg.render.records.view import COLOURS, MASK, View

f32 = np.float32

LESS_THAN_HALF = float(np.nextafter(f32(0.5), f32(0)))
"""Greatest number below a half: light above it is at least a half, and a pixel below it is one of plants for good."""


@cache
def tracer(reduced: bool, drawn: int, with_props: bool = False) -> Callable:
    """Return the kernel for a quality and for what is drawn (see `Output`): without colours, it finds only depth, class
    and mask; for the mask alone, bridges, props and plants only where they hide water. Frames that have no props are
    drawn by a kernel that knows none."""
    coloured, only_mask = drawn == COLOURS, drawn == MASK
    closed = LESS_THAN_HALF
    if coloured:
        closed = reduced_billboard.CLOSED if reduced else billboard.CLOSED

    def trace(scene, views, cameras, moments, nearness, plants, props, buffers):
        """One block a tile (x) of a camera (y): fill `Buffers` [N, H, W].

        moments: of `visible_plants.place_cameras`; nearness: of `ground_profiles.find_nearness`; plants: order,
        distance, boxes, counts of `visible_plants.find`; props: their rows, and what `posed_props.pose` fills.
        """
        n = cuda.blockIdx.y
        height, width = buffers.kind.shape[1:]
        tiles = (width + TILE - 1) // TILE
        tile_r = cuda.blockIdx.x // tiles * TILE
        tile_c = cuda.blockIdx.x % tiles * TILE
        r = tile_r + cuda.threadIdx.x // TILE
        c = tile_c + cuda.threadIdx.x % TILE
        camera = stored_camera(cameras, n, height, width)
        view = View(views.world_index[n], views.looks[n], camera, moments[n])
        depth = cuda.local.array(1, float32)
        rays = empty_rays()
        kind = primary_hit(scene, view, tile_r, tile_c, r, c, reduced, nearness[n], rays, depth)
        stone_r, stone_g, stone_b = f32(0), f32(0), f32(0)
        if not only_mask or kind == classes.WATER:
            kind, stone_r, stone_g, stone_b = nearest_bridge(scene, view, rays, depth, kind, coloured)
        corner = tile_r, tile_c
        behind, behind_depth = kind, depth[0]
        touched = cuda.shared.array(WORDS, uint32)
        stirred = cuda.shared.array(WORDS, uint32)
        cover, prop_r, prop_g, prop_b = f32(0), f32(0), f32(0), f32(0)
        if with_props:
            touch_props(props, n, corner, touched, stirred)
            kind, cover, prop_r, prop_g, prop_b = meet_props_at_pixel(
                scene, view, props, n, touched, r, c, depth, kind, only_mask, coloured
            )
        # Threads outside the image stay alive: they still load plants and meet the barriers.
        inside = r < height and c < width
        asked = inside and (not only_mask or kind == classes.WATER)
        red, green, blue, light, plant_depth = blend_plants(
            scene, view, plants, n, corner, r, asked, f32(closed), reduced, rays, depth
        )
        seen_depth = depth[0]
        passing = light * (f32(1) - cover)
        # As on the CPU, what dense foliage hides is not shaded.
        if coloured and passing > f32(SEEN):
            out = empty_radiance()
            depth[0] = behind_depth
            if behind == classes.BRIDGE:
                out.red[0] = stone_r
                out.green[0] = stone_g
                out.blue[0] = stone_b
            elif (
                with_props
                and not reduced
                and behind == classes.WATER
                and is_stirred(scene, view, props, n, stirred, r, c, rays, behind_depth)
            ):
                shade_stirred_at_pixel(scene, view, props, n, stirred, r, c, depth, out)
            else:
                shade_background(scene, view, behind, reduced, r, c, depth, out)
            red += passing * out.red[0]
            green += passing * out.green[0]
            blue += passing * out.blue[0]
        if coloured and with_props:
            red += light * prop_r
            green += light * prop_g
            blue += light * prop_b
        if inside:
            buffers.depth[n, r, c] = seen_depth
            buffers.kind[n, r, c] = kind
            buffers.transmittance[n, r, c] = light
            buffers.plant_depth[n, r, c] = plant_depth
            if coloured:
                buffers.red[n, r, c] = red
                buffers.green[n, r, c] = green
                buffers.blue[n, r, c] = blue

    return trace
