"""What picture stands for a plant? An atlas of every kind from eight sides, lit by the sun, with mip levels.

A view is named by the light, not by the plant: view v shows the plant to a camera whose horizontal look direction makes
the angle 2π·v/VIEWS, counter-clockwise, with the direction towards the sun. View 0 looks into the sun and shows the
plant back-lit, view VIEWS/2 shows it front-lit. So the atlas depends on the height of the sun only; its azimuth enters
at look-up (`view_of`). The camera looks down by `LOOK_DOWN` and the picture plane is upright, as a billboard is.
"""

import contextlib
import math
import zipfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from thalweg.core.atomic_io import atomic_path
from thalweg.core.cache import PACKAGE, cache_dir, code_hash
from thalweg.render.bake import sprites
from thalweg.render.bake.trees import Model, grow
from thalweg.world.species import KINDS, Kind

VIEWS = 8
ROWS, COLS = 128, 64
"""Texels of a picture on level 0: row 0 is the foot, the last row the top; column 0 is on the camera's left."""
LEVELS = 6
"""Mip levels, each half as high and wide as the one before; the last is 4 x 2."""
LOOK_DOWN = math.radians(10)
ELEVATION_STEP = math.radians(5)
"""The sun's elevation is rounded to this, so that worlds with almost the same sun share an atlas."""
SHARPER = 1.6
"""Factor on the contrast of single leaves: looking up between texels takes about as much of it away."""
MOST_GAIN = 1.8
"""Averaging takes the sparkle of leaves out of far levels; at most this factor on their detail puts it back."""
FINE = 4
"""Samples along each side of a texel of level 0."""
SOURCES = (PACKAGE / "core" / "jit.py", PACKAGE / "world" / "species.py", *Path(__file__).parent.glob("*.py"))
STAMP = code_hash(SOURCES)
"""Taken on import: a process older than the sources on the disk must not store its atlas under their name."""


@dataclass(frozen=True)
class Atlas:
    """Pictures of all kinds: K kinds, VIEWS views, LEVELS levels."""

    texels: np.ndarray
    """[T, 4] uint8. Red, green, blue: square-root coded radiance, linear = (value / 255)**2, where 1 is a white surface
    that faces the full sun under an open sky; not multiplied by coverage, and continued into empty texels.
    Fourth: coverage, linear, 255 = full."""
    offset: np.ndarray
    """[LEVELS] int64, so that the texel of (kind, view, level, row, column) is
    offset[level] + ((kind * VIEWS + view) * rows(level) + row) * cols(level) + column."""
    shade: np.ndarray
    """[K, VIEWS, 3] float32: radiance of the plant where no direct sun reaches it, as a share of that in full sun. With
    a share s of the sun, the radiance is that of the texel times shade + (1 - shade) * s."""

    @property
    def packed(self) -> np.ndarray:
        """[T] uint32, the same memory, one number a texel (red in the lowest byte on a little-endian machine)."""
        return self.texels.view(np.uint32).ravel()

    def picture(self, kind: int, view: int, level: int = 0) -> np.ndarray:
        """The texels [rows, columns, 4] uint8 of one picture, foot first."""
        size = rows(level) * cols(level)
        start = int(self.offset[level]) + (kind * VIEWS + view) * size
        return self.texels[start : start + size].reshape(rows(level), cols(level), 4)


def rows(level: int) -> int:
    """Rows of a picture on a level."""
    return ROWS >> level


def cols(level: int) -> int:
    """Columns of a picture on a level."""
    return COLS >> level


def view_of(look: float, sun_azimuth: float) -> int:
    """The view nearest to the horizontal look direction `look`, with the sun towards `sun_azimuth`; both in radians."""
    return round((look - sun_azimuth) * VIEWS / (2 * math.pi)) % VIEWS


def atlas(sun_elevation: float) -> Atlas:
    """The atlas for a height of the sun in radians, from memory, from the disk, or made now.

    Raises `ValueError` for a sun that is not between the horizon and the zenith.
    """
    if not 0.0 < sun_elevation <= math.pi / 2:
        raise ValueError(f"sun_elevation must be in (0, pi/2], got {sun_elevation}")
    return remembered(max(1, round(sun_elevation / ELEVATION_STEP)))


@cache
def remembered(steps: int) -> Atlas:
    """The atlas for a sun `steps` times ELEVATION_STEP high, read-only and shared by all who ask."""
    path = cache_dir() / f"atlas-{STAMP}-{steps}.npz"
    made = stored(path)
    if made is None:
        made = build(steps * ELEVATION_STEP)
        store(made, path)
    for array in (made.texels, made.offset, made.shade):
        array.setflags(write=False)
    return made


def build(sun_elevation: float) -> Atlas:
    """Grow, light and draw every kind; the same bytes every time."""
    with ThreadPoolExecutor() as pool:  # the kernels let go of Python's lock
        drawn = list(pool.map(lambda kind: draw_kind(kind, sun_elevation), KINDS))
    full = np.stack([picture for picture, _ in drawn]).reshape(-1, ROWS, COLS, 4)
    shade = np.stack([share for _, share in drawn]).astype(np.float32)
    levels = dilated(mip_levels(full))
    sizes = [len(level.reshape(-1, 4)) for level in levels]
    offset = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    return Atlas(np.concatenate([coded(level).reshape(-1, 4) for level in levels]), offset, shade)


def draw_kind(kind: Kind, sun_elevation: float) -> tuple[np.ndarray, np.ndarray]:
    """All views of a kind: RGB times coverage, and coverage [VIEWS, ROWS, COLS, 4]; and its `shade` [VIEWS, 3]."""
    model = grow(kind)
    sun_share, sky_share = sprites.light(model, sun_elevation)
    if kind.group == "rock":  # convex: it shades itself by turning away, and by nothing else
        sun_share = np.ones_like(sun_share)
    if kind.group == "tree":
        sky_share = sky_share * (1 - sprites.STAND * np.clip(1 - model.centre[:, 2], 0, 1))
    lit = sprites.radiance(model, sun_elevation, sun_share, sky_share)
    dark = sprites.radiance(model, sun_elevation, np.zeros_like(sun_share), sky_share)
    sides = [np.concatenate(pair, axis=1) for pair in zip(lit, dark, strict=True)]
    looks = [(math.cos(2 * math.pi * v / VIEWS), math.sin(2 * math.pi * v / VIEWS)) for v in range(VIEWS)]
    top, half_width = extent(model, looks)
    scale = (np.float32(COLS / 2 / half_width), np.float32(ROWS / top))
    pictures, shades = [], []
    for look in np.array(looks, np.float32):
        projection = sprites.Projection(look, np.float32(math.tan(LOOK_DOWN)), *scale, ROWS, COLS, FINE)
        ellipses = sprites.Ellipses(model.centre, model.along, model.across, model.normal)
        picture = sprites.draw(ellipses, *sides, projection)
        pictures.append(np.ascontiguousarray(picture[..., [0, 1, 2, 6]]))
        shades.append(picture[..., 3:6].sum((0, 1)) / picture[..., :3].sum((0, 1)))
    return np.stack(pictures), np.stack(shades)


def extent(model: Model, looks: list[tuple[float, float]]) -> tuple[float, float]:
    """Greatest height in the picture plane over all views, and greatest distance from its middle line."""
    look = np.array(looks)
    depth = model.centre[:, :2] @ look.T
    aside = model.centre[:, :2] @ np.column_stack([look[:, 1], -look[:, 0]]).T
    high = model.centre[:, 2:] + depth * math.tan(LOOK_DOWN)
    leaf = float(np.median(np.linalg.norm(model.along, axis=1)))
    return float(np.quantile(high, 0.9995)) + leaf, float(np.quantile(np.abs(aside), 0.9985)) + leaf


def mip_levels(full: np.ndarray) -> list[np.ndarray]:
    """Pictures [P, rows, cols, 4] (RGB times coverage, and coverage) on each level, with coverage kept."""
    levels = [full]
    for _ in range(LEVELS - 1):
        fine = levels[-1]
        p, r, c, _ = fine.shape
        levels.append(fine.reshape(p, r // 2, 2, c // 2, 2, 4).mean((2, 4)))
    wanted_solid = (full[..., 3] >= 0.5).mean((1, 2))
    wanted_mean = full[..., 3].mean((1, 2))
    for level in levels[1:]:
        for picture, solid, mean in zip(level, wanted_solid, wanted_mean, strict=True):
            cover = picture[..., 3].copy()
            picture[..., 3] = keep_coverage(cover, float(solid), float(mean))
            picture[..., :3] *= (picture[..., 3] / np.maximum(cover, 1e-6))[..., None]
    wanted_contrast = SHARPER * detail(full)[2]
    for level in levels[:-1]:
        coarse, fine, contrast = detail(level)
        gain = min(max(wanted_contrast / contrast, 1.0), MOST_GAIN)
        level[..., :3] = np.maximum(coarse + gain * fine, 0.12 * coarse) * level[..., 3:]
    return levels


def detail(level: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean colour of the 4 x 4 block round each texel, the texel's distance from it, and the size of that distance.

    Of pictures [P, rows, cols, 4] (RGB times coverage, and coverage); the first two [P, rows, cols, 3], the last as a
    share of the mean colour.
    """
    p, r, c, _ = level.shape
    block = level.reshape(p, r // 4, 4, c // 4, 4, 4).sum((2, 4))
    coarse = (block[..., :3] / np.maximum(block[..., 3:], 1e-6)).repeat(4, axis=1).repeat(4, axis=2)
    cover = level[..., 3:]
    fine = np.where(cover > 1e-3, level[..., :3] / np.maximum(cover, 1e-6) - coarse, 0)
    spread = math.sqrt(float((cover * fine**2).sum() / (3 * cover.sum())))
    return coarse, fine, spread * float(cover.sum()) / float(level[..., :3].sum() / 3)


def keep_coverage(cover: np.ndarray, solid: float, mean: float) -> np.ndarray:
    """Coverage [...] bent so that a share `solid` of it is at least one half, and its mean is nearest to `mean`.

    Averaging alone lets thin foliage fall under the half and thick foliage close its gaps (Castaño 2010, "Computing
    alpha mipmaps"). The bend maps 0, the threshold and 1 to 0, 1/2 and 1, with a power on either side.
    """
    count = round(solid * cover.size)
    ranked = np.sort(cover, axis=None)[::-1]
    threshold = float(np.clip(ranked[max(count, 1) - 1], 1e-3, 0.999))
    below = np.minimum(cover / threshold, 1.0)
    above = np.clip((1.0 - cover) / (1.0 - threshold), 0.0, 1.0)
    best = cover
    distance = np.inf
    for power in np.geomspace(0.5, 2.5, 17):
        bent = np.where(cover >= threshold, 1.0 - 0.5 * above**power, 0.5 * below ** (1.0 / power))
        if abs(bent.mean() - mean) < distance:
            best, distance = bent, abs(bent.mean() - mean)
    return best


def dilated(levels: list[np.ndarray]) -> list[np.ndarray]:
    """The levels with RGB divided by coverage; an empty texel takes the colour of its parent on the next level."""
    result = []
    parent = None
    for level in reversed(levels):
        cover = level[..., 3:]
        colour = level[..., :3] / np.maximum(cover, 1e-6)
        if parent is None:
            mean = level[..., :3].sum((1, 2), keepdims=True) / np.maximum(cover.sum((1, 2), keepdims=True), 1e-6)
            parent = np.broadcast_to(mean, colour.shape)
        else:
            parent = parent.repeat(2, axis=1).repeat(2, axis=2)
        parent = np.where(cover > 1e-3, colour, parent)
        result.append(np.concatenate([parent, cover], -1))
    return result[::-1]


def coded(level: np.ndarray) -> np.ndarray:
    """Linear RGB and coverage [..., 4] as uint8: RGB square-root coded, coverage linear."""
    roots = np.sqrt(np.clip(level[..., :3], 0, 1))
    return np.rint(255 * np.concatenate([roots, np.clip(level[..., 3:], 0, 1)], -1)).astype(np.uint8)


def store(made: Atlas, path: Path) -> None:
    """Write an atlas whole or not at all; a folder that can't be written to only costs the time to make it again."""
    with contextlib.suppress(OSError), atomic_path(path) as draft, draft.open("wb") as file:
        np.savez_compressed(file, texels=made.texels, offset=made.offset, shade=made.shade)


def stored(path: Path) -> Atlas | None:
    """The atlas in a file, or None if there is none or it is damaged."""
    total = len(KINDS) * VIEWS * sum(rows(level) * cols(level) for level in range(LEVELS))
    try:
        with np.load(path) as file:
            made = Atlas(file["texels"], file["offset"], file["shade"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    fits = made.texels.shape == (total, 4) and made.texels.dtype == np.uint8 and len(made.offset) == LEVELS
    return made if fits and made.shade.shape == (len(KINDS), VIEWS, 3) else None
