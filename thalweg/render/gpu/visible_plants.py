"""GPU kernels for the posed cameras of a pass, and for the plants that each of them sees, from near to far.

These functions are kernels once `thalweg.core.compute.gpu` has compiled them; as they stand, Numba's simulator runs
them. The sort is that of `plants.draw.visible_plants`, by one block of threads a camera.
"""

import numpy as np
from numba import cuda, int32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import pose_camera
from thalweg.render.kernels.frame import noise_key
from thalweg.render.kernels.plants.draw import BUCKETS, billboard_box, bucket_of, distance_in_view, frustum_of
from thalweg.render.records import layout
from thalweg.render.records.appearance import DENSITY
from thalweg.render.records.view import PosedCamera, View

f32 = np.float32

THREADS = 256
"""Threads of a block."""
EACH = BUCKETS // THREADS
"""Buckets that a thread counts together; THREADS divides BUCKETS."""
CAMERA_COLUMNS = 15
"""Numbers of a stored camera: the fields of `PosedCamera` before the size of the image."""


@kernel(inlined=True)
def stored_camera(cameras, n, height, width):
    """The `PosedCamera` number n of cameras [N, CAMERA_COLUMNS]."""
    return PosedCamera(
        cameras[n, 0], cameras[n, 1], cameras[n, 2], cameras[n, 3], cameras[n, 4], cameras[n, 5], cameras[n, 6],
        cameras[n, 7], cameras[n, 8], cameras[n, 9], cameras[n, 10], cameras[n, 11], cameras[n, 12], cameras[n, 13],
        cameras[n, 14], height, width,
    )  # fmt: skip


def place_cameras(views, settings, cameras, moments, keys):
    """One thread a camera: its fields [N, CAMERA_COLUMNS] float32, its time [N] float32, its noise key [N] uint32."""
    n = cuda.grid(1)
    # The last block may have more threads than cameras are left.
    if n >= len(views.poses):
        return
    camera = pose_camera(views.poses[n], views.looks[n], settings)
    (
        cameras[n, 0], cameras[n, 1], cameras[n, 2], cameras[n, 3], cameras[n, 4], cameras[n, 5], cameras[n, 6],
        cameras[n, 7], cameras[n, 8], cameras[n, 9], cameras[n, 10], cameras[n, 11], cameras[n, 12], cameras[n, 13],
        cameras[n, 14], _, _,
    ) = camera  # fmt: skip
    moments[n] = f32(views.times[n])
    keys[n] = noise_key(View(views.world_index[n], views.looks[n], camera, f32(views.times[n])))


def find(scene, views, settings, cameras, order, distance, boxes, counts):
    """One block a camera: the numbers of the plants in view, near to far, go to order [N, M], how many to counts [N].

    distance [N, M] float32: horizontal metres by a plant's number, -1 for one that is not in view. boxes [N, M, 4]
    int16: the columns from, to and rows from, to that the billboard at that index of the order may touch.
    """
    n = cuda.blockIdx.x
    thread = cuda.threadIdx.x
    w = views.world_index[n]
    first = scene.extents[w, layout.PLANT_FROM]
    total = scene.extents[w, layout.PLANT_TO] - first
    camera = stored_camera(cameras, n, settings.height, settings.width)
    frustum = frustum_of(camera.half_w, camera.half_h)
    ends = cuda.shared.array(BUCKETS, int32)
    sums = cuda.shared.array(THREADS, int32)

    for b in range(thread, BUCKETS, THREADS):
        ends[b] = 0
    cuda.syncthreads()
    for p in range(thread, total, THREADS):
        far = distance_in_view(scene.plants, first + p, views.looks[n, DENSITY], camera, frustum)
        distance[n, p] = far
        if far >= f32(0):
            # First the number of plants in each bucket, then their positions, as in the counting sort of the CPU.
            cuda.atomic.add(ends, bucket_of(far), 1)
    cuda.syncthreads()
    count = counts_to_offsets(ends, sums, thread)
    for p in range(thread, total, THREADS):
        far = distance[n, p]
        if far >= f32(0):
            order[n, cuda.atomic.add(ends, bucket_of(far), 1)] = p
    cuda.syncthreads()
    # Each bucket now ends where the next begins.
    for b in range(thread, BUCKETS, THREADS):
        sort_bucket(order[n], distance[n], ends[b - 1] if b > 0 else int32(0), ends[b])
    cuda.syncthreads()
    for k in range(thread, count, THREADS):
        p = order[n, k]
        # Boxes are stored by position in the order, so that the threads of a tile read neighbours.
        box = billboard_box(scene.plants[first + p], distance[n, p], camera, settings.width)
        boxes[n, k, 0], boxes[n, k, 1], boxes[n, k, 2], boxes[n, k, 3] = box
    if thread == 0:
        counts[n] = count


@kernel(inlined=True)
def counts_to_offsets(ends, sums, thread):
    """Replace the counts of the buckets by where each begins; returns their sum.

    A parallel prefix sum (Hillis, Steele 1986): of a thread's own buckets, then of all threads before it.
    """
    own = int32(0)
    for k in range(EACH):
        own += ends[thread * EACH + k]
    sums[thread] = own
    cuda.syncthreads()
    reach = 1
    while reach < THREADS:
        before = sums[thread - reach] if thread >= reach else int32(0)
        # All threads have read before any writes.
        cuda.syncthreads()
        sums[thread] += before
        cuda.syncthreads()
        reach *= 2
    # The sums include the thread's own buckets; its first bucket begins before them.
    begin = sums[thread] - own
    for k in range(EACH):
        inside = ends[thread * EACH + k]
        ends[thread * EACH + k] = begin
        begin += inside
    total = sums[THREADS - 1]
    cuda.syncthreads()
    return total


@kernel(inlined=True)
def sort_bucket(order, distance, begin, end):
    """Sort order[begin:end] by distance, then by number: atomic additions have left it in any order."""
    for k in range(begin + 1, end):
        p = order[k]
        far = distance[p]
        j = k - 1
        while j >= begin and (distance[order[j]] > far or (distance[order[j]] == far and order[j] > p)):
            order[j + 1] = order[j]
            j -= 1
        order[j + 1] = p
