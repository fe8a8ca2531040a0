"""Tests of props drawn over tiles, against a twin that meets each part pixel by pixel."""

import numpy as np
import pytest

from tests.render.lake import LEVEL, lake, row
from thalweg.core.compute.jit import kernel
from thalweg.render import Camera, Look
from thalweg.render.bake.scene_tables import build_scene
from thalweg.render.kernels.camera_rays import pose_camera
from thalweg.render.kernels.props import marks as columns
from thalweg.render.kernels.props import models
from thalweg.render.kernels.props.draw import draw_props
from thalweg.render.kernels.props.layers import (
    HALF,
    LEAST_COVER,
    is_hidden,
    layered,
    no_layers,
    pixel_sight,
    seen_depth,
    sharpness,
    total_cover,
    total_radiance,
    uncut_share,
)
from thalweg.render.kernels.props.paint import sight_radiance
from thalweg.render.kernels.props.pose import C0, C1, FADE, R0, R1, SHAPE, TAPER, solid_ray
from thalweg.render.kernels.props.posed_props import pose_props
from thalweg.render.kernels.props.solids import meet_solid
from thalweg.render.kernels.shading.background import CHUNK
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.classes import GROUND, WATER
from thalweg.render.records.props import CLASS_OFFSET, KIND, PropKind
from thalweg.render.records.view import COLOURS, MASK, FrameSettings, View

f32 = np.float32


@kernel
def by_tiles(scene, settings, pose, look, props, drawn, depth, kind):
    """Marks [M, MARK_COLUMNS] of props in the view of a pose, and whether a tile has all of a prop."""
    view = View(0, look, pose_camera(pose, look, settings), f32(1))
    posed = pose_props(scene, view, props)
    whole = True
    for box in posed.boxes:
        whole = whole and (box[1] - box[0]) * (box[3] - box[2]) <= CHUNK
    return draw_props(scene, view, props, posed, 0, drawn, depth, kind), whole


@kernel
def one_by_one(scene, settings, pose, look, props, depth, kind, shown):
    """Set depth and kind [H, W], and add to shown [H, W, 4] what props cover of a pixel, and their radiance."""
    view = View(0, look, pose_camera(pose, look, settings), f32(1))
    posed = pose_props(scene, view, props)
    pixel = f32(2) * view.camera.half_h / f32(settings.height)
    for k in range(len(posed.counts)):
        for r in range(settings.height):
            for c in range(settings.width):
                sight = pixel_sight(view.camera, r, c)
                sharp = sharpness(view.camera, sight.z, depth[r, c], kind[r, c] == WATER)
                layers = no_layers()
                for part in posed.parts[k * models.MOST_PARTS : k * models.MOST_PARTS + posed.counts[k]]:
                    if c < part[C0] or c >= part[C1] or r < part[R0] or r >= part[R1]:
                        continue
                    hit = meet_solid(part[SHAPE], part[TAPER], solid_ray(part, view.camera, sight.sx, sight.sy))
                    cover = hit.cover * part[FADE] * uncut_share(view.camera, hit.t, depth[r, c], sharp)
                    if cover < f32(LEAST_COVER):
                        continue
                    red, green, blue = sight_radiance(scene, view, part, pixel, sight, hit)
                    share = f32(0) if is_hidden(layers, hit.t) else cover
                    layers = layered(layers, cover, hit.t, share * red, share * green, share * blue)
                cover = total_cover(layers)
                if cover < f32(LEAST_COVER):
                    continue
                left = f32(1) - shown[r, c, 0]
                red, green, blue = total_radiance(layers)
                shown[r, c, 1] += left * red
                shown[r, c, 2] += left * green
                shown[r, c, 3] += left * blue
                shown[r, c, 0] += left * cover
                if cover >= f32(HALF):
                    depth[r, c] = seen_depth(layers, cover)
                    kind[r, c] = int(props[posed.numbers[k], KIND]) + CLASS_OFFSET


def composed(marks: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """What marks [M, MARK_COLUMNS] show [H, W, 4] as `one_by_one` has it; those of near props come first."""
    shown = np.zeros((*shape, 4), f32)
    for mark in marks:
        at = int(mark[columns.ROW]), int(mark[columns.COLUMN])
        left = 1 - shown[at][0]
        shown[at][1:] += left * mark[columns.RED : columns.BLUE + 1]
        shown[at][0] += left * mark[columns.COVER]
    return shown


@pytest.mark.slow
@pytest.mark.parametrize(("width", "whole"), [(96, True), (700, False)])
def test_tiles_show_what_each_pixel_would_alone(width: int, whole: bool):
    """Far props fit into a tile each. In a wide frame the boat before the camera needs several side by side."""
    camera = Camera(64, width)
    scene, settings = build_scene([lake()]), FrameSettings(64, width, f32(0.3), False)
    look = look_rows(look_values(Look(), 1), camera)[0]
    near = [] if whole else [row(PropKind.KAYAK, 2.6, 0.0, 1.4)]
    far = [row(PropKind.BUOY, 12.0, 2.0), row(PropKind.SWIMMER, 10.0, -1.0, 0.4, 1.0), row(PropKind.KAYAK, 14.0, 1.0)]
    props = np.array([*near, *far, row(PropKind.STATION, 18.0, -4.0, 2.0)], f32)
    pose = np.array([0.0, 0.0, LEVEL + 2.0, 0.0])
    rng = np.random.default_rng(0)
    plain = rng.uniform(3, 25, (64, width)).astype(f32), rng.choice([WATER, GROUND], (64, width)).astype(np.uint8)
    depth, kind = plain[0].copy(), plain[1].copy()
    marks, found_whole = by_tiles(scene, settings, pose, look, props, COLOURS, depth, kind)
    assert found_whole == whole
    slow_depth, slow_kind, shown = plain[0].copy(), plain[1].copy(), np.zeros((64, width, 4), f32)
    one_by_one(scene, settings, pose, look, props, slow_depth, slow_kind, shown)
    np.testing.assert_allclose(composed(marks, (64, width)), shown, atol=2e-5)
    assert (kind == slow_kind).mean() > 0.9999 and (kind > GROUND).sum() > 40
    same = kind == slow_kind
    np.testing.assert_allclose(depth[same], slow_depth[same], rtol=1e-4)
    # Of a mask only what was water changes.
    depth, masked = plain[0].copy(), plain[1].copy()
    no_marks, _ = by_tiles(scene, settings, pose, look, props, MASK, depth, masked)
    assert len(no_marks) == 0
    np.testing.assert_array_equal(masked == WATER, (plain[1] == WATER) & (kind == WATER))
    np.testing.assert_array_equal(masked[plain[1] == GROUND], GROUND)
