"""Kernels that pose the parts of props before a camera: which props are in view, where, and over which pixels.

A posed part is a row of numbers: the maps from the world's directions and from pixels to the coordinates of its solid,
what it looks like, and the rectangle of pixels that it may touch. All that a pixel computes for a prop it computes
within such a rectangle.
"""

import math

import numpy as np
from numba import int32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import row_step
from thalweg.render.kernels.props import models
from thalweg.render.kernels.props.boxes import part_box, pixel_box, seen_at
from thalweg.render.kernels.props.solids import SolidRay
from thalweg.render.kernels.props.turns import Turn, joined, joint_turn, turn_of, turned
from thalweg.render.kernels.table_lookup import bilinear, clamp, paint_level, top_map
from thalweg.render.records import layout
from thalweg.render.records.props import KIND, PHASE, YAW, X, Y, Z

f32 = np.float32

FAR_M = 150.0
"""Props farther than this are not drawn."""
LEAST_PX = 0.5
"""Half the least size of a part in pixels: what is thinner is drawn as thick as this, and as much paler."""
LEAST_SEEN = 0.6
"""A part whose longest half is shorter than this share of that least size is not drawn."""
STRETCH = 0.2
"""How far ripples stretch a mirror image to either side, as a share of its width, and, twice that, down its height."""
DETAIL_M = (0.2, 0.3)
"""Side of a pixel, where a prop is, over which all but its main parts fade away."""
LEAST_LAND_M = 0.25
"""Least height above the water of what stands on land."""

# Columns of a posed part. The map has three rows: what it makes of x, y and z in metres. Then, all in the solid's own
# coordinates: the camera, and the directions ahead, to the right and up, of which rays are made.
SHAPE, TAPER, MAP = 0, 1, 2
CAMERA, AHEAD, RIGHT, UP = 11, 14, 17, 20
FADE, SUNLIT, LEVEL = 23, 24, 25
LOOKS = 26
"""Where the columns of `models.PARTS` from RED on begin."""
C0 = LOOKS + models.MODEL_COLUMNS - models.RED
C1, R0, R1 = range(C0 + 1, C0 + 4)
"""The rectangle of pixels: columns from, to and rows from, to."""
MIDDLE, REACH = C0 + 4, C0 + 7
"""The middle in metres from the camera, three columns, and the radius of the ball around the part."""
PART_COLUMNS = REACH + 1


@kernel(inlined=True, allocates=False)
def depth_of(camera, prop):
    """Return the depth in metres of the water at a prop."""
    ahead = (prop[X] - camera.x) * camera.forward_x + (prop[Y] - camera.y) * camera.forward_y
    return ahead + (prop[Z] - camera.z) * camera.forward_z


@kernel(inlined=True, allocates=False)
def depth_in_view(prop, camera):
    """Return the depth in metres of a prop's middle if any of it, or of the water around it, may be seen; else -1."""
    kind = int32(prop[KIND])
    if kind == 0:
        return f32(-1)
    x = prop[X] - camera.x
    y = prop[Y] - camera.y
    z = prop[Z] + models.KINDS[kind, models.MIDDLE] - camera.z
    # The water that mirrors a prop lies no farther from it than its height, where the camera is higher than it.
    radius = models.KINDS[kind, models.RADIUS] + models.KINDS[kind, models.WAVE_REACH]
    ahead = x * camera.forward_x + y * camera.forward_y + z * camera.forward_z
    across = abs(x * camera.right_x + y * camera.right_y)
    above = abs(x * camera.up_x + y * camera.up_y + z * camera.up_z)
    slant_w = math.sqrt(f32(1) + camera.half_w * camera.half_w)
    slant_h = math.sqrt(f32(1) + camera.half_h * camera.half_h)
    inside = (ahead > -radius) & (ahead < f32(FAR_M))
    inside = inside & (across < ahead * camera.half_w + radius * slant_w)
    inside = inside & (above < ahead * camera.half_h + radius * slant_h)
    return max(ahead, f32(0)) if inside else f32(-1)


@kernel(allocates=False)
def sort_in_view(props, camera, order, depth):
    """Fill order [P] int32 with the numbers of the props that may be in view, near to far; returns how many there are.

    depth: [P] float32, scratch.
    """
    count = 0
    for p in range(len(props)):
        ahead = depth_in_view(props[p], camera)
        if ahead < f32(0):
            continue
        j = count
        while j > 0 and depth[j - 1] > ahead:
            depth[j] = depth[j - 1]
            order[j] = order[j - 1]
            j -= 1
        depth[j] = ahead
        order[j] = p
        count += 1
    return count


@kernel(inlined=True, allocates=False)
def pose_prop(scene, view, prop, parts):
    """Fill parts [MOST_PARTS, PART_COLUMNS] with those of a prop as a view sees them; returns how many there are."""
    kind = int32(prop[KIND])
    phase = prop[PHASE]
    first = int32(models.KINDS[kind, models.FIRST])
    count = int32(models.KINDS[kind, models.LAST]) - first
    swing, sway = f32(math.sin(phase)), f32(math.cos(phase))
    body = turn_of(
        prop[YAW], models.KINDS[kind, models.ROCK_PITCH] * sway, models.KINDS[kind, models.ROCK_ROLL] * swing
    )
    bob = models.KINDS[kind, models.BOB] * swing
    lift, sunlit = ground_at(scene, view.world, prop, body)
    pixel = depth_of(view.camera, prop) * row_step(view.camera)
    detail = clamp((f32(DETAIL_M[1]) - pixel) / f32(DETAIL_M[1] - DETAIL_M[0]), f32(0), f32(1))
    if detail == f32(0):
        count = int32(models.KINDS[kind, models.MAIN])
    for k in range(count):
        model = models.PARTS[first + k]
        own = Turn(
            model[models.TURN], model[models.TURN + 1], model[models.TURN + 2],
            model[models.TURN + 3], model[models.TURN + 4], model[models.TURN + 5],
            model[models.TURN + 6], model[models.TURN + 7], model[models.TURN + 8],
        )  # fmt: skip
        x, y, z = model[models.OFFSET_X], model[models.OFFSET_Y], model[models.OFFSET_Z]
        if model[models.JOINT] == f32(models.ON_LAND):
            z += lift
        elif model[models.JOINT] != f32(models.FIXED):
            # Few parts move; the sines of the others would take longer than all the rest.
            joint = joint_turn(model[models.JOINT], phase)
            own = joined(joint, own)
            x, y, z = turned(joint, x, y, z)
        x, y, z = turned(body, x + model[models.PIVOT_X], y + model[models.PIVOT_Y], z + model[models.PIVOT_Z])
        pose_part(view.camera, model, joined(body, own), prop[X] + x, prop[Y] + y, prop[Z] + z + bob, parts[k])
        parts[k, FADE] *= f32(1) if k < int32(models.KINDS[kind, models.MAIN]) else detail
        parts[k, SUNLIT] = sunlit
        parts[k, LEVEL] = prop[Z]
    return count


@kernel(inlined=True, allocates=False)
def ground_at(scene, world, prop, body):
    """Return the height above the water, in metres, of the land that a prop stands on, and the share of sun there."""
    back = f32(-models.HUT_M) if int32(prop[KIND]) == int32(models.STATION_KIND) else f32(0)
    inv_cell = scene.constants[world, layout.INV_CELL]
    x = (prop[X] + body.xx * back - scene.constants[world, layout.ORIGIN_X]) * inv_cell
    y = (prop[Y] + body.xy * back - scene.constants[world, layout.ORIGIN_Y]) * inv_cell
    lift = max(bilinear(top_map(scene, world), x, y) - prop[Z], f32(LEAST_LAND_M))
    columns = int32(scene.extents[world, layout.PAINT_X])
    rows = int32(scene.extents[world, layout.PAINT_Y])
    # The second level is smooth enough for all of a prop.
    begin = int32(scene.extents[world, layout.PAINT_AT + 1])
    _, _, _, sun = paint_level(scene.paint, begin, columns, rows, x, y, int32(1))
    return lift, clamp(sun * f32(1 / 255.0), f32(0), f32(1))


@kernel(inlined=True, allocates=False)
def pose_part(camera, model, turn, x, y, z, part):
    """Fill a posed part [PART_COLUMNS], all but `SUNLIT` and `LEVEL`: a row of `models.PARTS` with its middle at x, y,
    z in metres, after a `Turn`. `FADE` is 0 for one that is too small to be seen."""
    px = x - camera.x
    py = y - camera.y
    pz = z - camera.z
    ahead = px * camera.forward_x + py * camera.forward_y + pz * camera.forward_z
    least = max(ahead, camera.near_m) * row_step(camera) * f32(LEAST_PX)
    part[FADE] = f32(0)
    part[C0], part[C1], part[R0], part[R1] = f32(0), f32(0), f32(0), f32(0)
    part[MIDDLE], part[MIDDLE + 1], part[MIDDLE + 2] = px, py, pz
    # What would hardly be seen is left out.
    if max(model[models.HALF_X], max(model[models.HALF_Y], model[models.HALF_Z])) < f32(LEAST_SEEN) * least:
        return
    half_x = max(model[models.HALF_X], least)
    half_y = max(model[models.HALF_Y], least)
    half_z = max(model[models.HALF_Z], least)
    # A cube's corner is √3 of its half size away, and nothing else is farther.
    longest = max(half_x, max(half_y, half_z))
    part[REACH] = (
        longest
        if model[models.SHAPE] == f32(models.SPHERE)
        else math.sqrt(half_x * half_x + half_y * half_y + half_z * half_z)
    )
    part[SHAPE] = model[models.SHAPE]
    part[TAPER] = model[models.TAPER]
    # The map is the inverse of turn and stretch: its rows are the solid's axes over its half sizes.
    part[MAP], part[MAP + 1], part[MAP + 2] = turn.xx / half_x, turn.xy / half_x, turn.xz / half_x
    part[MAP + 3], part[MAP + 4], part[MAP + 5] = turn.yx / half_y, turn.yy / half_y, turn.yz / half_y
    part[MAP + 6], part[MAP + 7], part[MAP + 8] = turn.zx / half_z, turn.zy / half_z, turn.zz / half_z
    part[CAMERA], part[CAMERA + 1], part[CAMERA + 2] = mapped(part, -px, -py, -pz)
    part[AHEAD], part[AHEAD + 1], part[AHEAD + 2] = mapped(part, camera.forward_x, camera.forward_y, camera.forward_z)
    part[RIGHT], part[RIGHT + 1], part[RIGHT + 2] = mapped(part, camera.right_x, camera.right_y, f32(0))
    part[UP], part[UP + 1], part[UP + 2] = mapped(part, camera.up_x, camera.up_y, camera.up_z)
    # A part is as much paler as its outline is wider than it should be.
    seen = outline_area(part, half_x, half_y, half_z, model[models.HALF_X], model[models.HALF_Y], model[models.HALF_Z])
    part[FADE] = seen * model[models.OPACITY]
    for k in range(models.MODEL_COLUMNS - models.RED):
        part[LOOKS + k] = model[models.RED + k]
    box = part_box(camera, turn, half_x, half_y, half_z, px, py, pz)
    part[C0], part[C1], part[R0], part[R1] = f32(box[0]), f32(box[1]), f32(box[2]), f32(box[3])


@kernel(inlined=True, allocates=False)
def mapped(part, x, y, z):
    """Return what the map of a posed part makes of a vector in metres."""
    return (
        part[MAP] * x + part[MAP + 1] * y + part[MAP + 2] * z,
        part[MAP + 3] * x + part[MAP + 4] * y + part[MAP + 5] * z,
        part[MAP + 6] * x + part[MAP + 7] * y + part[MAP + 8] * z,
    )


@kernel(inlined=True, allocates=False)
def outline_area(part, wide_x, wide_y, wide_z, half_x, half_y, half_z):
    """Return the area of an ellipsoid's outline, as the camera of a posed part sees it, over that of a wider one."""
    # The shadow of an ellipsoid along a unit vector v has the area pi * sqrt(sum of (v_i * h_j * h_k)²).
    x = part[CAMERA] * wide_x
    y = part[CAMERA + 1] * wide_y
    z = part[CAMERA + 2] * wide_z
    a, b, c = x * half_y * half_z, y * half_x * half_z, z * half_x * half_y
    d, e, f = x * wide_y * wide_z, y * wide_x * wide_z, z * wide_x * wide_y
    return math.sqrt((a * a + b * b + c * c) / (d * d + e * e + f * f + f32(1e-20)))


@kernel(inlined=True, allocates=False)
def mirror_box(part, camera):
    """Return the columns from, to and rows from, to of the image that the mirror image of a posed part may touch.

    It is that in calm water, stretched by ripples.
    """
    # The map's rows are perpendicular: those of its inverse are its columns over their squares.
    a = part[MAP] * part[MAP] + part[MAP + 1] * part[MAP + 1] + part[MAP + 2] * part[MAP + 2]
    b = part[MAP + 3] * part[MAP + 3] + part[MAP + 4] * part[MAP + 4] + part[MAP + 5] * part[MAP + 5]
    c = part[MAP + 6] * part[MAP + 6] + part[MAP + 7] * part[MAP + 7] + part[MAP + 8] * part[MAP + 8]
    px, py, pz = part[MIDDLE], part[MIDDLE + 1], part[MIDDLE + 2]
    low_x, high_x, low_y, high_y = f32(1e9), f32(-1e9), f32(1e9), f32(-1e9)
    behind = 0
    for corner in range(8):
        u = (f32(1) if corner & 1 else f32(-1)) / a
        v = (f32(1) if corner & 2 else f32(-1)) / b
        w = (f32(1) if corner & 4 else f32(-1)) / c
        dx = part[MAP] * u + part[MAP + 3] * v + part[MAP + 6] * w
        dy = part[MAP + 1] * u + part[MAP + 4] * v + part[MAP + 7] * w
        dz = part[MAP + 2] * u + part[MAP + 5] * v + part[MAP + 8] * w
        # From the part to its image below the water.
        z = f32(2) * (part[LEVEL] - camera.z) - pz - dz
        ahead, sx, sy = seen_at(camera, px + dx, py + dy, z)
        behind += 1 if ahead < camera.near_m else 0
        low_x, high_x = min(low_x, sx), max(high_x, sx)
        low_y, high_y = min(low_y, sy), max(high_y, sy)
    # Ripples stretch a mirror image, most of all towards the camera.
    wide, high = high_x - low_x, high_y - low_y
    return pixel_box(
        camera, behind > 0,
        low_x - f32(STRETCH) * wide, high_x + f32(STRETCH) * wide, low_y - f32(2 * STRETCH) * high, high_y,
    )  # fmt: skip


@kernel(inlined=True, allocates=False)
def solid_ray(part, camera, sx, sy):
    """Return the `SolidRay` through a point of the image plane, in the coordinates of a posed part."""
    right, up = camera.column_step, row_step(camera)
    return SolidRay(
        part[CAMERA], part[CAMERA + 1], part[CAMERA + 2],
        part[AHEAD] + sx * part[RIGHT] + sy * part[UP],
        part[AHEAD + 1] + sx * part[RIGHT + 1] + sy * part[UP + 1],
        part[AHEAD + 2] + sx * part[RIGHT + 2] + sy * part[UP + 2],
        part[RIGHT] * right, part[RIGHT + 1] * right, part[RIGHT + 2] * right,
        part[UP] * up, part[UP + 1] * up, part[UP + 2] * up,
    )  # fmt: skip
