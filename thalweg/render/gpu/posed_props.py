"""The GPU kernel that poses the props of each camera: those in view, near to far, and the pixels that they touch."""

import numpy as np
from numba import cuda, float32, int32

from thalweg.render.gpu.visible_plants import stored_camera
from thalweg.render.kernels.props import models
from thalweg.render.kernels.props.pose import depth_in_view, pose_prop
from thalweg.render.kernels.props.posed_props import join_boxes
from thalweg.render.kernels.props.water import fill_zone
from thalweg.render.records.props import MOST_PROPS
from thalweg.render.records.view import View

f32 = np.float32

THREADS = MOST_PROPS
"""Threads of a block: one for each prop of a frame."""


def pose(scene, views, settings, cameras, moments, props, parts, numbers, boxes, zones, counts):
    """One block a camera: its props [N, P, PROP_COLUMNS] in view, near to far; how many there are goes to counts [N].

    parts [N, P * MOST_PARTS, PART_COLUMNS]: those of the k-th begin at k * MOST_PARTS; numbers [N, P, 2] int32: which
    prop it is, and its parts; boxes [N, P, 4] and zones [N, P, 8] int32: of `PosedProps` and `water.Stirred`.
    """
    n = cuda.blockIdx.x
    p = cuda.threadIdx.x
    camera = stored_camera(cameras, n, settings.height, settings.width)
    ahead = cuda.shared.array(THREADS, float32)
    ahead[p] = depth_in_view(props[n, p], camera) if p < props.shape[1] else f32(-1)
    cuda.syncthreads()
    # Each thread counts the props before its own, equal ones in the order of the list, as the CPU sorts them.
    rank = int32(0)
    total = int32(0)
    for q in range(props.shape[1]):
        seen = ahead[q] >= f32(0)
        total += int32(1) if seen else int32(0)
        nearer = ahead[q] < ahead[p] or (ahead[q] == ahead[p] and q < p)
        rank += int32(1) if seen and nearer else int32(0)
    if p == 0:
        counts[n] = total
    if ahead[p] >= f32(0):
        view = View(views.world_index[n], views.looks[n], camera, moments[n])
        first = rank * models.MOST_PARTS
        own = parts[n, first : first + models.MOST_PARTS]
        count = pose_prop(scene, view, props[n, p], own)
        numbers[n, rank, 0] = p
        numbers[n, rank, 1] = count
        join_boxes(own, count, boxes[n, rank])
        fill_zone(props[n, p], own, camera, zones[n, rank])
