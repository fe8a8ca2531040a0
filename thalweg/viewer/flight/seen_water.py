"""The bird's-eye map of a flight: the water that its masks have shown so far, in the frame of the vehicle.

It is the memory of the shield: see `thalweg.env.shield`. Nothing of it comes from the map of the river, so that it is
what frames can tell. Unlike the shield it reads where the vehicle is instead of adding up moves, and takes no water to
be under the vehicle that was not seen: some tasks cross land.
"""

import io
import math

import numpy as np
from PIL import Image, ImageDraw

from thalweg.env.shield.sight import Optics, look
from thalweg.env.shield.water_map import CELL_M, SIZE, empty_maps, follow
from thalweg.env.task.altimeter import heights_above_water
from thalweg.env.task.motion import Pose
from thalweg.render import Camera
from thalweg.render.records.appearance import HALF_H, HALF_W, PITCH, look_rows
from thalweg.viewer.flight.eye import Eye
from thalweg.viewer.flight.flight import Flight

AHEAD_M, BEHIND_M, ASIDE_M = 24.0, 8.0, 16.0
"""What is shown: ahead as far as masks are read, behind, and to either side."""
ROWS, COLUMNS = int((AHEAD_M + BEHIND_M) / CELL_M), int(2 * ASIDE_M / CELL_M)
UNSEEN, WATER, DRY = range(3)
"""What is known of a cell. Dry is what shows no water: land, or what something tall hides."""
COLOURS = ((38, 43, 51), (86, 170, 232), (178, 154, 106))
"""Colour of each of these, which the legend of the page repeats."""
VEHICLE = (235, 90, 60)
ARROW = ((0, -7), (5, 6), (0, 3), (-5, 6))
"""Corners of the vehicle's arrow in pixels, to the right and down of its place."""


def refusal(camera: Camera) -> str:
    """Return why the masks of a camera are not read; empty if they are."""
    return "no bird's-eye map: it reads masks of a pinhole, not of a camera with a lens" if camera.lens else ""


class SeenWater:
    """What the masks of one flight have shown since this began."""

    def __init__(self) -> None:
        self.maps = empty_maps(1)

    def look(self, flight: Flight, eye: Eye) -> None:
        """Enter the mask that an eye sees in the current state."""
        row = look_rows(flight.views().look, eye.camera)[0]
        optics = Optics(*(np.array([float(row[column])]) for column in (PITCH, HALF_W, HALF_H)))
        height = heights_above_water(flight.env.courses, flight.env.state)[0]
        x, y, _, yaw = map(float, flight.poses[-1])
        self.enter(eye.see(flight, 1)[0, ..., 0], Pose(x, y, float(height), yaw), optics)

    def enter(self, mask: np.ndarray, pose: Pose, optics: Optics) -> None:
        """Enter a mask [H, W] uint8 that is seen at a pose whose z is the height above the water."""
        mask = np.ascontiguousarray(mask)
        follow(self.maps, 0, pose.x, pose.y)
        look(self.maps, 0, pose, optics, mask, np.empty_like(mask))

    def cells(self, pose: np.ndarray) -> np.ndarray:
        """Return what is known [ROWS, COLUMNS] uint8 around a pose [4]: the first row is the furthest ahead, the first
        column the leftmost."""
        ahead = (AHEAD_M - (np.arange(ROWS) + 0.5) * CELL_M)[:, None]
        left = ASIDE_M - (np.arange(COLUMNS) + 0.5) * CELL_M
        cos, sin = math.cos(pose[3]), math.sin(pose[3])
        x, y = pose[0] + ahead * cos - left * sin, pose[1] + ahead * sin + left * cos
        i, j = (np.floor(axis / CELL_M).astype(np.int64) for axis in (x, y))
        corner = self.maps.corner[0]
        within = (i >= corner[0]) & (i < corner[0] + SIZE) & (j >= corner[1]) & (j < corner[1] + SIZE)
        odds = np.where(within, self.maps.odds[0, i & (SIZE - 1), j & (SIZE - 1)], 0)
        return np.where(odds > 0, WATER, np.where(odds < 0, DRY, UNSEEN)).astype(np.uint8)

    def picture(self, pose: np.ndarray) -> bytes:
        """Return the map around a pose [4] as a PNG, a pixel for each cell, with an arrow for the vehicle."""
        image = Image.fromarray(np.array(COLOURS, np.uint8)[self.cells(pose)])
        x, y = ASIDE_M / CELL_M, AHEAD_M / CELL_M
        ImageDraw.Draw(image).polygon([(x + right, y + down) for right, down in ARROW], VEHICLE)
        content = io.BytesIO()
        image.save(content, "PNG", compress_level=1)
        return content.getvalue()
