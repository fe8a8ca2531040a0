"""Which plants does each camera see, from near to far? One block of threads a camera, as `plants.visible_plants`.

These functions are kernels once `thalweg.core.gpu.compile_kernel` has compiled them; as they stand, Numba's simulator
runs them.
"""

import math

import numpy as np
from numba import cuda, int32

from thalweg.render.kernels.camera_rays import eye_of
from thalweg.render.kernels.frame import noise_key
from thalweg.render.kernels.plants import BUCKETS, bucket_of, distance_in_view, picture_box
from thalweg.render.records import scene as table
from thalweg.render.records.appearance import DENSITY

f32 = np.float32

THREADS = 256
"""A block's."""
EACH = BUCKETS // THREADS
"""Buckets that a thread counts together; THREADS divides BUCKETS."""
EYE = 15
"""Numbers of an eye, see `eye.open_eye`."""


def place_cameras(poses, times, looks, camera, eyes, moments, keys):
    """One thread a camera: its eye [N, EYE] float32, its time [N] float32, what its noise depends on [N] uint32.

    poses [N, 4], times [N] float64, looks [N, LOOK_COLUMNS]; camera: as of `batch.draw`.
    """
    n = cuda.grid(1)
    if n >= len(poses):
        return
    eye = eye_of(poses[n], looks[n], camera)
    (
        eyes[n, 0], eyes[n, 1], eyes[n, 2], eyes[n, 3], eyes[n, 4], eyes[n, 5], eyes[n, 6], eyes[n, 7],
        eyes[n, 8], eyes[n, 9], eyes[n, 10], eyes[n, 11], eyes[n, 12], eyes[n, 13], eyes[n, 14],
    ) = eye  # fmt: skip
    moments[n] = f32(times[n])
    keys[n] = noise_key(eye, f32(times[n]))


def find(scene, world_index, looks, camera, eyes, order, distance, boxes, counts):
    """One block a camera: the numbers of the plants in view, near to far, go to order [N, M], how many to counts [N].

    distance [N, M] float32: horizontal metres by a plant's number, -1 for one that is not in view. boxes [N, M, 4]
    int16: the columns from, to and rows from, to that the picture of the plant at that place in the order may touch.
    """
    n = cuda.blockIdx.x
    thread = cuda.threadIdx.x
    w = world_index[n]
    first = scene.place[w, table.PLANT_FROM]
    total = scene.place[w, table.PLANT_TO] - first
    eye = (
        eyes[n, 0], eyes[n, 1], eyes[n, 2], eyes[n, 3], eyes[n, 4], eyes[n, 5], eyes[n, 6], eyes[n, 7],
        eyes[n, 8], eyes[n, 9], eyes[n, 10], eyes[n, 11], eyes[n, 12], eyes[n, 13], eyes[n, 14],
    )  # fmt: skip
    ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, _, _ = eye
    slant_w = f32(math.sqrt(f32(1) + half_w * half_w))
    slant_h = f32(math.sqrt(f32(1) + half_h * half_h))
    ends = cuda.shared.array(BUCKETS, int32)
    sums = cuda.shared.array(THREADS, int32)

    for b in range(thread, BUCKETS, THREADS):
        ends[b] = 0
    cuda.syncthreads()
    for p in range(thread, total, THREADS):
        far = distance_in_view(
            scene.plants, first + p, looks[n, DENSITY],
            ox, oy, oz, fx, fy, fz, rx, ry, ux, uy, uz, half_w, half_h, slant_w, slant_h,
        )  # fmt: skip
        distance[n, p] = far
        if far >= f32(0):
            cuda.atomic.add(ends, bucket_of(far), 1)
    cuda.syncthreads()

    # Where each bucket begins: sums of a thread's own buckets, then of all threads before it.
    own = int32(0)
    for k in range(EACH):
        own += ends[thread * EACH + k]
    sums[thread] = own
    cuda.syncthreads()
    reach = 1
    while reach < THREADS:
        before = sums[thread - reach] if thread >= reach else int32(0)
        cuda.syncthreads()
        sums[thread] += before
        cuda.syncthreads()
        reach *= 2
    begin = sums[thread] - own
    for k in range(EACH):
        inside = ends[thread * EACH + k]
        ends[thread * EACH + k] = begin
        begin += inside
    count = sums[THREADS - 1]
    cuda.syncthreads()

    for p in range(thread, total, THREADS):
        far = distance[n, p]
        if far >= f32(0):
            order[n, cuda.atomic.add(ends, bucket_of(far), 1)] = p
    cuda.syncthreads()
    # Each bucket now ends where the next begins. Within one, plants stand in any order: by distance, then by number.
    for b in range(thread, BUCKETS, THREADS):
        begin = ends[b - 1] if b > 0 else int32(0)
        for k in range(begin + 1, ends[b]):
            p = order[n, k]
            far = distance[n, p]
            j = k - 1
            while j >= begin and (
                distance[n, order[n, j]] > far or (distance[n, order[n, j]] == far and order[n, j] > p)
            ):
                order[n, j + 1] = order[n, j]
                j -= 1
            order[n, j + 1] = p
    cuda.syncthreads()
    for k in range(thread, count, THREADS):
        p = order[n, k]
        box = picture_box(scene.plants[first + p], distance[n, p], eye, camera[0], camera[1])
        boxes[n, k, 0], boxes[n, k, 1], boxes[n, k, 2], boxes[n, k, 3] = box
    if thread == 0:
        counts[n] = count
