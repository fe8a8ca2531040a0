"""Draws the cases in Numba's CUDA simulator and stores the frames: `python -m tests.render.cuda.simulate FILE QUALITY`.

It must run with NUMBA_ENABLE_CUDASIM=1 and NUMBA_DISABLE_JIT=1: then every kernel is plain Python, and what the
simulator runs is the source itself, not the CPU's compiled form of it.
"""

import sys

import numba
import numpy as np
from numba import cuda

from tests.render.cuda import cases, one_pixel
from thalweg.render import plants, tone
from thalweg.render.eye import open_eye
from thalweg.render.frame import noise_key
from thalweg.render.look import DENSITY, look_rows, look_values
from thalweg.render.scene import build_scene

f32 = np.float32


def main(path: str, quality: str) -> None:
    fast = quality == "fast"
    assert numba.config.ENABLE_CUDASIM and numba.config.DISABLE_JIT  # pyright: ignore
    scene = build_scene([cases.world()])
    looks = look_rows(look_values(cases.LOOKS, len(cases.LOOKS)), cases.CAMERA)
    near = f32(cases.CAMERA.near_m)
    side = cases.SIDE
    images = np.zeros((len(cases.POSES), side, side), np.uint32)
    trace, soften, tone_frame = (cuda.jit(each) for each in (one_pixel.trace, one_pixel.soften, one_pixel.tone_frame))
    for pose, time, look, image in zip(cases.POSES, cases.TIMES, looks, images, strict=True):
        eye = open_eye(*pose, look, side, near)
        order, distance = np.zeros(len(scene.plants), np.int32), np.zeros(len(scene.plants), f32)
        count = plants.visible_plants(scene, 0, look[DENSITY], *eye[:13], order, distance)
        radiance, kind = np.zeros((side, side, 3), f32), np.zeros((side, side), np.int32)
        light, depth, softened = (
            np.zeros((side, side), f32),
            np.zeros((side, side), f32),
            np.zeros((side, side, 3), f32),
        )
        camera = np.array(eye, f32)
        trace[(2, 2), (4, 4)](
            scene, 0, camera, f32(time), look, fast, order[:count], distance, radiance, depth, kind, light
        )
        if fast:
            softened = radiance
        else:
            soften[(2, 2), (4, 4)](scene, 0, camera, look, depth, kind, light, radiance, softened)
        mean = f32(np.minimum(softened @ np.array(tone.LUMA, f32), tone.BRIGHTEST).mean())
        key = noise_key(eye, f32(time))
        tone_frame[(2, 2), (4, 4)](softened, kind, light, mean, look, key, tone.CODE_TABLE, image)
    np.save(path, images)


if __name__ == "__main__":
    main(*sys.argv[1:])
