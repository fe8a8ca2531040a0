"""Quays of the reference renderer: the stone of wall, coping and pavement at points, without filtering."""

from typing import Any

import numpy as np

from thalweg.render.bake import ripples
from thalweg.render.kernels.shading import quay
from thalweg.render.records import layout
from thalweg.render.reference.bridge import masonry
from thalweg.world.banks import QUAY_COPING_M, QUAY_FALL, QUAY_PAVED_M, QUAY_WALL_M, quay_slope


def slopes(field: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a map [GY, GX] and its rise per node in x and in y, all [K], bilinear at node coordinates [K]."""
    column = np.clip(np.floor(x).astype(int), 0, field.shape[1] - 2)
    row = np.clip(np.floor(y).astype(int), 0, field.shape[0] - 2)
    u, v = x - column, y - row
    a, b, c, d = (field[row + i, column + j] for i in (0, 1) for j in (0, 1))
    value = a * (1 - u) * (1 - v) + b * u * (1 - v) + c * (1 - u) * v + d * u * v
    return value, (b - a) * (1 - v) + (d - c) * v, (c - a) * (1 - u) + (d - b) * u


def over_ground(materials: Any, ground: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the radiance [K, 3] of `ground` [K, 3] at node coordinates [K], where a quay is that of its stone."""
    cell = materials.world.grid.cell_m
    depth, fall_x, fall_y = slopes(materials.wet, x, y)
    height, rise = -depth, np.stack([-fall_x, -fall_y], axis=-1) / cell
    steep = np.hypot(*rise.T) + 1e-6
    over = height - QUAY_WALL_M
    low, high = (share * quay_slope(cell) for share in quay.WALL_SHARES)
    wall = np.where(over < quay.TOP_M, np.clip((steep - low) / (high - low), 0, 1), 0.0)
    past = over / QUAY_FALL
    least, most = (share * QUAY_FALL for share in quay.FLAT_SHARES)
    paved = (steep > least) & (steep < most) & (past > -0.1) & (past < QUAY_PAVED_M)
    on_top = paved & (past < QUAY_COPING_M)
    coping = (over > -quay.COPING_HIGH_M) | on_top
    along = np.where(np.abs(rise[:, 1]) > np.abs(rise[:, 0]), x, y) * cell

    blocks = masonry(along, np.where(wall > 0, height, quay.BETWEEN_M))
    stones = masonry(along * quay.COPING_LONG, np.full_like(along, quay.BETWEEN_M))
    size = ripples.SIZE / quay.GRAIN_M
    grain = materials.grain(along * size, np.where(paved, past, height) * size)
    tone = np.where(coping, stones, blocks) * np.maximum(1 + quay.GRAIN_DEPTH * grain, 0.2)
    slime = np.clip((quay.SLIME_M - height) * quay.SLIME_EDGE + quay.SLIME_RAGGED * (blocks - 1), 0, quay.SLIME_MOST)
    slime = np.where(coping, 0.0, slime)[:, None]
    stone = np.where(coping[:, None], quay.COPING, quay.STONE) * tone[:, None]
    stone += slime * (np.array(quay.SLIME) - stone)

    up = 1 / np.sqrt(1 + steep**2)
    facing = np.maximum((materials.sun[2] - rise @ materials.sun[:2]) * up, 0)
    inland = rise * (quay.SUN_INLAND_M / steep / cell)[:, None]
    direct = materials.sunlit(x + inland[:, 0], y + inland[:, 1]) * facing
    sky = quay.OPEN_SKY + (1 - quay.OPEN_SKY) * up
    light = direct[:, None] * layout.SUN_RADIANCE + sky[:, None] * layout.SKY_RADIANCE + quay.BOUNCE

    belongs = materials.quayed(x, y)
    slabs = 1 + belongs * quay.SLAB_CONTRAST * (masonry(along * quay.SLAB, past * quay.SLAB) - 1)
    ground = ground * np.where(paved, slabs, 1.0)[:, None]
    covered = (belongs * np.where(on_top, 1.0, wall))[:, None]
    return ground + covered * (stone * light - ground)
