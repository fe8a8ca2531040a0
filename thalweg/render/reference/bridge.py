"""Bridges of the reference renderer: dense sampling of a solid, and masonry without filtering."""

import numpy as np

from thalweg.render.kernels import bridge_stone, bridges
from thalweg.world.record import PARAPET_THICKNESS_M


def masonry(along: np.ndarray, courses: np.ndarray) -> np.ndarray:
    """Return the brightness [K] of blocks and joints."""
    course = np.floor(courses / bridge_stone.COURSE_M)
    shifted = along / bridge_stone.BLOCK_M + 0.5 * course
    block = np.floor(shifted)
    mask = 0xFFFFFFFF
    mixed = (block.astype(np.int64) * 374761393 + course.astype(np.int64) * 668265263) & mask
    mixed = ((mixed ^ (mixed >> 13)) * 1274126177) & mask
    tint = ((mixed >> 16) & 255) / 255
    edge = np.minimum(
        np.minimum(shifted - block, block + 1 - shifted) * bridge_stone.BLOCK_M,
        np.minimum(courses / bridge_stone.COURSE_M - course, course + 1 - courses / bridge_stone.COURSE_M)
        * bridge_stone.COURSE_M,
    )
    joint = np.clip(1.4 - edge / bridge_stone.JOINT_M, 0, 1)
    return 1 + bridge_stone.BLOCK_CONTRAST * (tint - 0.5) - bridge_stone.JOINT_DEPTH * joint


def meet_bridge(
    bridge: np.ndarray, origin: np.ndarray, ray: np.ndarray, near: float, far: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return depth [R, C] (inf: miss), normal and point [R, C, 3] in the bridge's frame, by dense sampling."""
    x, y, angle, length, width, span, spring, rise, deck, hump, parapet = bridge
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1.0]])
    start, step = turn @ (origin - [x, y, 0]), ray @ turn.T

    def filled(p: np.ndarray) -> np.ndarray:
        u, v, z = p[..., 0], p[..., 1], p[..., 2]
        crown = deck - hump * (2 * u / length) ** 2
        across = np.clip(1 - (2 * u / span) ** 2, 0, None)
        hollow = (np.abs(u) < span / 2) & (z < spring + rise * np.sqrt(across))
        body = (np.abs(v) <= width / 2) & (z <= crown) & (z >= spring - bridges.FOOT_M) & ~hollow
        wall = (np.abs(v) <= width / 2) & (np.abs(v) >= width / 2 - PARAPET_THICKNESS_M)
        wall &= (z <= crown + parapet) & (z >= deck - hump)
        return (np.abs(u) <= length / 2) & (body | wall)

    flat, limit = step.reshape(-1, 3), np.broadcast_to(far, ray.shape[:2]).ravel()
    # Only the stretch of a ray within the ball around the bridge can meet it.
    centre = np.array([0, 0, (deck + spring) / 2])
    reach = np.linalg.norm([length / 2, width / 2, (deck + parapet - spring + bridges.FOOT_M) / 2 + 1])
    square = (flat**2).sum(1)
    middle = (flat @ (centre - start)) / square
    reach_left = reach**2 - ((start + flat * middle[:, None] - centre) ** 2).sum(1)
    half = np.sqrt(np.maximum(reach_left, 0) / square)
    begin, end = np.maximum(middle - half, near), np.minimum(middle + half, limit)
    live = np.flatnonzero((reach_left > 0) & (begin < end))
    found = np.full(len(flat), np.inf)
    t = begin.copy()
    while len(live):
        inside = filled(start + flat[live] * t[live, None])
        hit = live[inside]
        low, high = np.maximum(t[hit] - 0.03, begin[hit]), t[hit]
        for _ in range(20):
            mid = (low + high) / 2
            solid = filled(start + flat[hit] * mid[:, None])
            low, high = np.where(solid, low, mid), np.where(solid, mid, high)
        found[hit] = high
        live = live[~inside]
        t[live] += 0.03
        live = live[t[live] < end[live]]
    point = start + flat * np.where(np.isfinite(found), found, 0)[:, None]
    u, v, z = point.T
    normal = np.zeros_like(point)
    face = np.isclose(np.abs(v), width / 2, atol=1e-4) & (flat[:, 1] * v < 0)
    inner = np.isclose(np.abs(v), width / 2 - PARAPET_THICKNESS_M, atol=1e-4) & (flat[:, 1] * v > 0)
    inner &= z > deck - hump * (2 * u / length) ** 2
    normal[:, 1] = np.where(face | inner, -np.sign(flat[:, 1]), 0)
    on_top = ~(face | inner) & (z > deck - hump * (2 * u / length) ** 2 - 0.02)
    normal[on_top] = [0, 0, 1]
    end_face = ~(face | inner | on_top) & (np.abs(u) > length / 2 - 0.01)
    normal[:, 0] = np.where(end_face, np.sign(u), 0)
    vault = ~(face | inner | on_top | end_face)
    slope = np.stack([-u / (span / 2) ** 2, np.zeros_like(u), -np.maximum(z - spring, 0) / rise**2], axis=1)
    slope /= np.linalg.norm(slope, axis=1, keepdims=True) + 1e-12
    normal[vault] = slope[vault]
    shape = ray.shape[:2]
    return found.reshape(shape), normal.reshape(*shape, 3), point.reshape(*shape, 3)
