"""Renders the cases in the CUDA simulator: `python -m tests.cuda.simulate_frames FILE SCENE QUALITY`.

The frames go to FILE. SCENE holds the tables of the worlds, which compiled kernels have baked.
"""

import sys

import numpy as np

from tests.cuda import cases, simulated
from thalweg.render import Renderer, renderer
from thalweg.render.gpu.gpu_renderer import GpuRenderer
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.scene import Scene
from thalweg.render.records.view import FrameSettings, Views


def main(path: str, scene_path: str, quality: str) -> None:
    simulated.begin()
    count, side = len(cases.POSES), cases.SIDE
    with np.load(scene_path) as tables:
        scene = Scene(**tables)
    renderer.build_scene = lambda worlds: scene
    looks = look_rows(look_values(cases.LOOKS, count), cases.CAMERA)
    settings = FrameSettings(side, side, np.float32(cases.CAMERA.near_m), quality == "fast")
    on_device = GpuRenderer(scene, settings, simulated.DEVICE)
    on_device.cameras = cases.A_PASS
    views = Views(cases.WORLD_INDEX, cases.POSES, cases.TIMES, looks)
    shape = count, side, side
    images = np.zeros(shape, np.uint32)
    layers = np.zeros(shape, np.float32), np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    # A mask that is not wanted as a layer is in the images all the same.
    without_mask = (*layers[:2], None)
    on_device.draw(views, images, without_mask if quality == "fast" else layers)
    if quality == "fast":
        layers[2][:] = images >> 24
    alone = np.zeros(shape, np.float32), np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    on_device.draw(views, None, alone)
    masks = np.zeros(shape, np.uint8)
    on_device.draw(views, masks=masks)
    with_props = np.zeros(shape, np.uint32)
    prop_layers = np.zeros(shape, np.float32), np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    on_device.draw(views, with_props, prop_layers, props=cases.PROPS)
    prop_masks = np.zeros(shape, np.uint8)
    on_device.draw(views, masks=prop_masks, props=cases.PROPS)
    found = {"images": images, "depth": layers[0], "kind": layers[1], "mask": layers[2]}
    found |= {"alone_depth": alone[0], "alone_kind": alone[1], "alone_mask": alone[2], "only_mask": masks}
    found |= {"props_images": with_props, "props_only_mask": prop_masks}
    found |= dict(zip(("props_depth", "props_kind", "props_mask"), prop_layers, strict=True))
    if quality == "fast":  # which takes a simulator less time
        public = Renderer(cases.drawn_worlds(), cases.CAMERA, quality, simulated.DEVICE)
        frame = public.render_layers(cases.POSES[:1], look=cases.LOOKS[:1])
        found |= {"rgb": frame.rgb, "depth_m": frame.depth_m, "class_id": frame.class_id}
        found["public_mask"] = public.render_mask(cases.POSES[:1], look=cases.LOOKS[:1])
    np.savez(path, **found)


if __name__ == "__main__":
    main(*sys.argv[1:])
