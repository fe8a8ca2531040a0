"""The reference renderer, which defines a frame: plain NumPy in float64, many samples a pixel, no prefiltering.

When a kernel and this file differ, this file is checked first. Rays are marched in small steps over the world's
own heights, and instead of choosing a level of a texture by the pixel's footprint it averages samples of the finest.
What is baked before any ray is drawn is shared with the kernels and tested by itself: the ground's radiance, the map of
canopies, the sky, the tile of ripples, the billboards of plants, and all constants. It is slow on purpose: a 32x32
frame with 16 samples a pixel takes a few seconds.
"""

from dataclasses import dataclass, replace

import numpy as np

from thalweg.render.errors import RenderError
from thalweg.render.kernels import bridges
from thalweg.render.kernels.shading import tone
from thalweg.render.kernels.terrain import heightfield_march
from thalweg.render.records import appearance, classes
from thalweg.render.records.appearance import Look, look_rows, look_values
from thalweg.render.records.camera import Camera
from thalweg.render.reference import bridge as reference_bridge
from thalweg.render.reference.materials import Materials, bilinear
from thalweg.render.reference.plants import blend_plants
from thalweg.render.reference.props import Props
from thalweg.world.record import World


@dataclass(frozen=True)
class ReferenceFrame:
    """One frame of the reference renderer."""

    rgb: np.ndarray
    """[H, W, 3] uint8."""
    mask: np.ndarray
    """[H, W] bool, by the ray through each pixel's centre."""
    depth_m: np.ndarray
    """[H, W] float64 along the optical axis, by the centre ray; -1 for the sky."""
    class_id: np.ndarray
    """[H, W] uint8, by the centre ray."""


def draw(
    world: World,
    pose: np.ndarray,
    camera: Camera,
    *,
    samples: int = 4,
    time_s: float = 0.0,
    look: Look | None = None,
    props: np.ndarray | None = None,
) -> ReferenceFrame:
    """Return the frame of a pose [4] (x, y, z, yaw) with samples x samples rays per pixel, without sensor noise.

    props: [P, 6], see `thalweg.render.records.props`.
    """
    if camera.lens is not None:
        raise RenderError("the reference renderer draws pinholes: leave the camera's lens out")
    seen = look or Look()
    row = look_rows(look_values(seen, 1), camera)[0].astype(np.float64)
    camera = replace(camera, pitch_deg=camera.pitch_deg + seen.pitch_deg, fov_deg=camera.fov_deg + seen.fov_deg)
    materials = Materials(world, row)
    if props is not None and len(props):
        materials.props = Props(materials, props)
    radiance, _, _ = trace(materials, pose, camera, samples, time_s)
    height, width = camera.height_px, camera.width_px
    radiance = radiance.reshape(height, samples, width, samples, 3).mean(axis=(1, 3))
    luma = np.minimum(radiance @ np.array(tone.LUMA), tone.BRIGHTEST).mean()
    grey = (radiance @ np.array(tone.LUMA))[..., None]
    vivid = np.maximum(grey + (radiance - grey) * tone.SATURATION, 0.0)
    exposed = vivid * (tone.KEY / max(luma, 1e-4)) ** tone.ADAPTATION * row[appearance.GAIN_R : appearance.GAIN_B + 1]
    rgb = np.rint(tone.encode(tone.curve(exposed)) * 255).astype(np.uint8)
    _, depth, kind = trace(materials, pose, camera, 1, time_s)
    return ReferenceFrame(rgb, kind == classes.WATER, np.where(np.isinf(depth), -1.0, depth), kind)


def trace(
    materials: Materials, pose: np.ndarray, camera: Camera, samples: int, time_s: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return radiance [R, C, 3], depth [R, C] (inf: sky) and class [R, C] of samples x samples rays per pixel."""
    rows, columns = camera.height_px * samples, camera.width_px * samples
    sy = camera.half_height * (1 - 2 * (np.arange(rows) + 0.5) / rows)
    sx = camera.half_width * (2 * (np.arange(columns) + 0.5) / columns - 1)
    forward, right, up = axes(pose[3], np.radians(camera.pitch_deg))
    ray = forward + sy[:, None, None] * up + sx[None, :, None] * right
    origin = np.asarray(pose[:3], np.float64)

    depth = meet_ground(materials, origin, ray, camera.near_m)
    kind = np.where(np.isinf(depth), classes.SKY, classes.GROUND).astype(np.uint8)
    radiance = np.zeros((rows, columns, 3))
    for bridge in materials.world.bridges:
        depth_b, normal, local = reference_bridge.meet_bridge(
            bridge, origin, ray, camera.near_m, np.minimum(depth, bridges.FAR_M)
        )
        met = np.isfinite(depth_b)
        depth = np.where(met, depth_b, depth)
        kind[met] = classes.BRIDGE
        radiance[met] = materials.stone(bridge, normal[met], local[met])

    point = origin + ray * np.where(np.isinf(depth), 0.0, depth)[..., None]
    far = np.where(np.isinf(depth), 0.0, depth) * np.linalg.norm(ray, axis=-1)
    sight = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
    x, y = materials.node(point[..., 0], point[..., 1])
    kind[(kind == classes.GROUND) & (bilinear(materials.wet, x, y) > 0)] = classes.WATER
    sky_seen = kind == classes.SKY
    radiance[sky_seen] = materials.sky(sight[sky_seen])
    dry = kind == classes.GROUND
    radiance[dry] = materials.ground(x[dry], y[dry])
    wet = kind == classes.WATER
    radiance[wet] = materials.water(point[wet], sight[wet], time_s)
    clear = np.exp(-far * materials.look[appearance.HAZE_PER_M])[..., None]
    radiance = np.where(sky_seen[..., None], radiance, radiance * clear + materials.fog * (1 - clear))

    if materials.props is not None:
        shown, passing, prop_depth, prop_kind = materials.props.before(origin, ray, camera.near_m, depth)
        radiance = shown + passing[..., None] * radiance
        depth = np.minimum(depth, prop_depth)
        kind = np.where(prop_kind > 0, prop_kind, kind)

    green, light, solid = blend_plants(materials, origin, ray, (forward, right, up), camera, depth)
    radiance = green + light[..., None] * radiance
    covered = light <= 0.5
    return radiance, np.where(covered, solid, depth), np.where(covered, classes.PLANT, kind).astype(np.uint8)


def meet_ground(materials: Materials, origin: np.ndarray, ray: np.ndarray, near: float) -> np.ndarray:
    """Return the depth [R, C] at which each ray meets the surface; inf where it leaves the map."""
    flat = ray.reshape(-1, 3)
    t = np.full(len(flat), near)
    before, found = t.copy(), np.full(len(flat), np.inf)
    live = np.arange(len(flat))
    summit = materials.surface.max()
    while len(live):
        p = origin + flat[live] * t[live, None]
        gap = p[:, 2] - bilinear(materials.surface, *materials.node(p[:, 0], p[:, 1]))
        below = gap <= 0
        hit = live[below]
        low, high = before[hit], t[hit]
        for _ in range(30):
            middle = (low + high) / 2
            p = origin + flat[hit] * middle[:, None]
            inside = p[:, 2] <= bilinear(materials.surface, *materials.node(p[:, 0], p[:, 1]))
            low, high = np.where(inside, low, middle), np.where(inside, middle, high)
        found[hit] = high
        live, gap = live[~below], gap[~below]
        before[live] = t[live]
        speed = np.linalg.norm(flat[live, :2], axis=1)
        by_height = 0.4 * gap / np.maximum(1.5 * speed - flat[live, 2], 0.05)
        t[live] += np.maximum(np.maximum(0.03, 0.002 * t[live]), by_height)
        gone = (t[live] > heightfield_march.FAR_M) | (
            (flat[live, 2] > 0) & (origin[2] + flat[live, 2] * t[live] > summit)
        )
        live = live[~gone]
    return np.where(found < heightfield_march.FAR_M, found, np.inf).reshape(ray.shape[:2])


def axes(yaw: float, pitch: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the forward, right and up unit vectors of a camera."""
    level = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    forward = level * np.cos(pitch) - up * np.sin(pitch)
    return forward, np.array([np.sin(yaw), -np.cos(yaw), 0.0]), level * np.sin(pitch) + up * np.cos(pitch)
