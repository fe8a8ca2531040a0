"""A gallery of looks: one view at both ends of every range of domain randomisation."""

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from thalweg.render import Camera, Look, Randomisation, Renderer
from thalweg.render.records.appearance import PARAMETERS
from thalweg.world import World

GAP_PX, TITLE_PX = 4, 18
STRIPS = 2
"""Strips of three frames in a row of the gallery."""
BACKGROUND, TEXT = (255, 255, 255), (30, 30, 30)


def gallery(world: World, pose: np.ndarray, camera: Camera, ranges: Randomisation | None = None) -> Image.Image:
    """Return a strip for each range: the view from a pose [4] at its lower end, by default, and at its upper end.

    Where the default is an end, the middle of the range takes its place.

    The sun's ranges are shown at three azimuths, and at both ends of the elevation; each needs the world relit.
    """
    ranges = ranges or Randomisation()
    renderer = Renderer([world], camera)
    default = Look()
    strips = []
    for name in PARAMETERS:
        low, high, usual = (float(value) for value in (*getattr(ranges, name), getattr(default, name)))
        # A default at an end would be shown twice.
        middle = usual if low < usual < high else 0.5 * (low + high)
        looks = [Look(**{name: value}) for value in (low, middle, high)]
        frames = renderer.render(np.tile(pose, (3, 1)), look=looks)
        inside = "in the middle" if low < usual < high else "outside"
        where = {low: "at the left", high: "at the right"}.get(usual, inside)
        strips.append(strip(f"{name}: {low:g} to {high:g}; default {usual:g} {where}", frames[..., :3]))
    strips += sun_strips(world, pose, camera, ranges)
    return arrange_strips(strips)


def sun_strips(world: World, pose: np.ndarray, camera: Camera, ranges: Randomisation) -> list[Image.Image]:
    """Return the same view under suns in three directions, and under a low sun, the world's own and a high one."""
    first, last = np.radians(ranges.sun_azimuth_deg)
    azimuths = np.linspace(first, last, 3, endpoint=False) + (last - first) / 6
    low, high = np.radians(ranges.sun_elevation_deg)
    around = [world.relit(azimuth, world.sun_elevation) for azimuth in azimuths]
    up = [world.relit(world.sun_azimuth, low), world, world.relit(world.sun_azimuth, high)]
    titles = (
        f"sun_azimuth_deg: {', '.join(f'{a:.0f}' for a in np.degrees(azimuths))}",
        f"sun_elevation_deg: {np.degrees(low):g} to {np.degrees(high):g}; the world's own in the middle",
    )
    return [
        strip(title, Renderer(suns, camera).render(np.tile(pose, (3, 1)), np.arange(3))[..., :3])
        for title, suns in zip(titles, (around, up), strict=True)
    ]


def strip(title: str, frames: np.ndarray) -> Image.Image:
    """Return frames [K, H, W, 3] uint8 in a row under a title."""
    count, height, width, _ = frames.shape
    picture = Image.new("RGB", (count * width + (count - 1) * GAP_PX, TITLE_PX + height), BACKGROUND)
    ImageDraw.Draw(picture).text((0, 2), title, TEXT, ImageFont.load_default(size=12))
    for index, frame in enumerate(frames):
        picture.paste(Image.fromarray(frame), (index * (width + GAP_PX), TITLE_PX))
    return picture


def arrange_strips(strips: list[Image.Image]) -> Image.Image:
    """Return strips of one size in a grid, row by row."""
    width, height = strips[0].size
    rows = -(-len(strips) // STRIPS)
    step_x, step_y = width + 4 * GAP_PX, height + 2 * GAP_PX
    page = Image.new("RGB", (STRIPS * step_x - 4 * GAP_PX, rows * step_y - 2 * GAP_PX), BACKGROUND)
    for index, picture in enumerate(strips):
        page.paste(picture, (index % STRIPS * step_x, index // STRIPS * step_y))
    return page
