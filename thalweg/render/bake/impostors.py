"""Plant impostors: an atlas of pictures of every kind of plant from eight sides, lit by the sun, with mip levels.

Views are numbered relative to the sun: view v shows the plant to a camera whose horizontal look direction makes the
angle 2π·v/VIEWS, counter-clockwise, with the direction towards the sun. View 0 looks into the sun and shows the plant
back-lit, view VIEWS/2 shows it front-lit. Therefore the atlas depends only on the height of the sun; its azimuth is
used at look-up (`view_of`). The camera looks down by `LOOK_DOWN`, and the picture plane is upright, as a billboard is.
"""

import contextlib
import itertools
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from thalweg.core.atomic_io import atomic_path
from thalweg.core.cache import PACKAGE, cache_dir, code_hash, keep_in_use
from thalweg.core.compute.jit import machine_hash
from thalweg.render.bake import sprites
from thalweg.render.bake.trees import Model, grow
from thalweg.world.species import KINDS, Kind

VIEWS = 8
ROWS, COLS = 256, 128
"""Texels of a picture on level 0: row 0 is the foot, the last row the top; column 0 is on the camera's left."""
LEVELS = 7
"""Mip levels, each half as high and wide as the one before; the last is 4 x 2."""
LOOK_DOWN = math.radians(10)
ELEVATION_STEP = math.radians(5)
"""The sun's elevation is rounded to this, so that worlds with almost the same sun share an atlas."""
SHARPER = 1.6
"""Factor on the contrast of single leaves, which compensates for the interpolation between texels."""
MOST_GAIN = 1.8
"""Upper limit of the factor that restores the contrast that averaging removes from coarse levels."""
FINE = 2
"""Samples along each side of a texel of level 0."""
SOURCES = (
    *(PACKAGE / "core" / "compute" / name for name in ("jit.py", "kernel_compiler.py")),
    PACKAGE / "world" / "species.py",
    *Path(__file__).parent.glob("*.py"),
)
SOURCE_HASH = code_hash(SOURCES)
"""Computed on import, so that a process that runs older code than the files hold does not store its atlas under their
hash."""


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
        """Return the texels [rows, columns, 4] uint8 of one picture; row 0 is the foot."""
        size = rows(level) * cols(level)
        start = int(self.offset[level]) + (kind * VIEWS + view) * size
        return self.texels[start : start + size].reshape(rows(level), cols(level), 4)


def rows(level: int) -> int:
    """Return the number of rows of a picture on a level."""
    return ROWS >> level


def cols(level: int) -> int:
    """Return the number of columns of a picture on a level."""
    return COLS >> level


def view_of(look: float, sun_azimuth: float) -> int:
    """Return the view nearest to the look direction `look` for a sun at `sun_azimuth`; both in radians."""
    return round((look - sun_azimuth) * VIEWS / (2 * math.pi)) % VIEWS


def atlas(sun_elevation: float) -> Atlas:
    """Return the atlas for a height of the sun in radians, from memory or the disk if it is there.

    Raises `ValueError` for a sun that is not between the horizon and the zenith.
    """
    if not 0.0 < sun_elevation <= math.pi / 2:
        raise ValueError(f"sun_elevation must be in (0, pi/2], got {sun_elevation}")
    return remembered(sun_steps(sun_elevation))


def sun_steps(sun_elevation: float) -> int:
    """Return the height of a sun in steps of ELEVATION_STEP; suns of the same height share an atlas."""
    return max(1, round(sun_elevation / ELEVATION_STEP))


@cache
def remembered(steps: int) -> Atlas:
    """Return the read-only, shared atlas for a sun `steps` times ELEVATION_STEP high.

    Atlases that were not used for long, of this version or another, are removed from the disk.
    """
    path = atlas_path(steps)
    made = stored(path)
    if made is None:
        made = build(steps * ELEVATION_STEP)
        store(made, path)
    keep_in_use(path, "atlas-*.npz")
    for array in (made.texels, made.offset, made.shade):
        array.setflags(write=False)
    return made


def atlas_path(steps: int) -> Path:
    """Return the path of an atlas in the cache; its name holds what may change a bit of it."""
    return cache_dir() / f"atlas-{SOURCE_HASH}-{np.__version__}-{machine_hash()}-{steps}.npz"


def build(sun_elevation: float) -> Atlas:
    """Grow, light and draw every kind. The result is deterministic."""
    with ThreadPoolExecutor() as pool:  # the kernels release the GIL
        drawn = list(pool.map(lambda kind: draw_kind(kind, sun_elevation), KINDS))
    full = np.stack([picture for picture, _ in drawn]).reshape(-1, ROWS, COLS, 4)
    shade = np.stack([share for _, share in drawn]).astype(np.float32)
    levels = dilated(mip_levels(full))
    offset = np.array(level_starts()[:-1], np.int64)
    return Atlas(np.concatenate([coded(level).reshape(-1, 4) for level in levels]), offset, shade)


def level_starts() -> list[int]:
    """Return the number of the first texel of each level, and that of all texels."""
    sizes = (len(KINDS) * VIEWS * rows(level) * cols(level) for level in range(LEVELS))
    return [0, *itertools.accumulate(sizes)]


def draw_kind(kind: Kind, sun_elevation: float) -> tuple[np.ndarray, np.ndarray]:
    """Return all views of a kind [VIEWS, ROWS, COLS, 4] (RGB times coverage, coverage) and `shade` [VIEWS, 3]."""
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
    """Return the greatest height in the picture plane over all views, and the greatest distance from its axis."""
    look = np.array(looks)
    depth = model.centre[:, :2] @ look.T
    sideways = model.centre[:, :2] @ np.column_stack([look[:, 1], -look[:, 0]]).T
    high = model.centre[:, 2:] + depth * math.tan(LOOK_DOWN)
    leaf = float(np.median(np.linalg.norm(model.along, axis=1)))
    return float(np.quantile(high, 0.9995)) + leaf, float(np.quantile(np.abs(sideways), 0.9985)) + leaf


def mip_levels(full: np.ndarray) -> list[np.ndarray]:
    """Return pictures [P, rows, cols, 4] (RGB times coverage, and coverage) on each level; coverage is preserved.

    Level 0 is only seen where a plant fills the view. Its few samples a texel are too rough to measure by, so all
    farther levels follow level 1.
    """
    levels = [halved(full)]
    for _ in range(LEVELS - 2):
        levels.append(halved(levels[-1]))
    wanted_solid = (levels[0][..., 3] >= 0.5).mean((1, 2))
    wanted_mean = levels[0][..., 3].mean((1, 2))
    for level in levels[1:]:
        for picture, solid, mean in zip(level, wanted_solid, wanted_mean, strict=True):
            cover = picture[..., 3].copy()
            picture[..., 3] = keep_coverage(cover, float(solid), float(mean))
            picture[..., :3] *= (picture[..., 3] / np.maximum(cover, 1e-6))[..., None]
    wanted_contrast = SHARPER * detail(levels[0])[2]
    for level in levels[:-1]:
        coarse, fine, contrast = detail(level)
        gain = min(max(wanted_contrast / contrast, 1.0), MOST_GAIN)
        level[..., :3] = sharpened(coarse, fine, gain) * level[..., 3:]
    nearest = full.copy()
    for picture, near in zip(nearest, levels[0], strict=True):  # one at a time, because this level is large
        # Its own detail upon the colours of level 1, so that averages of both are equal.
        cover = picture[..., 3:]
        plain, wanted = (part[..., :3] / np.maximum(part[..., 3:], 1e-6) for part in (halved(picture[None])[0], near))
        plain, wanted = (part.repeat(2, axis=0).repeat(2, axis=1) for part in (plain, wanted))
        fine = np.where(cover > 1e-3, picture[..., :3] / np.maximum(cover, 1e-6) - plain, 0)
        picture[..., :3] = sharpened(wanted, fine, 1.0) * cover
    return [nearest, *levels]


def halved(level: np.ndarray) -> np.ndarray:
    """Return pictures [P, rows, cols, 4] at half their height and width, by means of 2 x 2 texels."""
    p, r, c, _ = level.shape
    return level.reshape(p, r // 2, 2, c // 2, 2, 4).mean((2, 4))


def sharpened(coarse: np.ndarray, fine: np.ndarray, gain: float) -> np.ndarray:
    """Return colours whose differences `fine` from their surroundings `coarse` are `gain` times as large."""
    return np.maximum(coarse + gain * fine, 0.12 * coarse)


def detail(level: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the mean colour of the 4 x 4 block round each texel, each texel's difference from it, and its contrast.

    level: pictures [P, rows, cols, 4] (RGB times coverage, and coverage). The first two are [P, rows, cols, 3]; the
    contrast is the standard deviation of the differences as a share of the mean colour.
    """
    p, r, c, _ = level.shape
    block = level.reshape(p, r // 4, 4, c // 4, 4, 4).sum((2, 4))
    coarse = (block[..., :3] / np.maximum(block[..., 3:], 1e-6)).repeat(4, axis=1).repeat(4, axis=2)
    cover = level[..., 3:]
    fine = np.where(cover > 1e-3, level[..., :3] / np.maximum(cover, 1e-6) - coarse, 0)
    spread = math.sqrt(float((cover * fine**2).sum() / (3 * cover.sum())))
    return coarse, fine, spread * float(cover.sum()) / float(level[..., :3].sum() / 3)


def keep_coverage(cover: np.ndarray, solid: float, mean: float) -> np.ndarray:
    """Return coverage [...] remapped: a share `solid` of it is at least one half, and its mean is close to `mean`.

    Averaging alone makes thin foliage vanish and closes the gaps of thick foliage (Castaño 2010, "Computing
    alpha mipmaps"). The remapping takes 0, the threshold and 1 to 0, 1/2 and 1, with a power function on either side.
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
    """Return the levels with RGB divided by coverage; an empty texel has the colour of its parent level."""
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
    """Return linear RGB and coverage [..., 4] as uint8: RGB square-root coded, coverage linear."""
    roots = np.sqrt(np.clip(level[..., :3], 0, 1))
    return np.rint(255 * np.concatenate([roots, np.clip(level[..., 3:], 0, 1)], -1)).astype(np.uint8)


def store(made: Atlas, path: Path) -> None:
    """Write an atlas atomically; if the folder is not writable, nothing is stored."""
    with contextlib.suppress(OSError), atomic_path(path) as draft, draft.open("wb") as file:
        # Not compressed: a third of the size would take ten times as long to read.
        np.savez(file, texels=made.texels, offset=made.offset, shade=made.shade)


def stored(path: Path) -> Atlas | None:
    """Return the atlas in a file, or None if the file is missing or damaged."""
    *starts, total = level_starts()
    try:
        with np.load(path) as file:
            made = Atlas(file["texels"], file["offset"], file["shade"])
    except Exception:  # a damaged archive raises nearly anything
        return None
    fits = made.texels.shape == (total, 4) and made.texels.dtype == np.uint8
    fits = fits and made.offset.dtype == np.int64 and made.offset.tolist() == starts
    fits = fits and made.shade.shape == (len(KINDS), VIEWS, 3) and made.shade.dtype == np.float32
    return made if fits and np.isfinite(made.shade).all() else None
