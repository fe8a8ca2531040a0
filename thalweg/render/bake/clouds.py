"""Fair-weather clouds over a world: cumulus, and streaks of cirrus above it, baked into a map of the upper sky.

The cumulus layer is a field over the ground, high where a cloud grows: where it exceeds a threshold there is a cloud
with a flat base, the taller the more it exceeds it. What a ray sees of the layer is the greatest value along it of the
field less what that height asks for. The map holds that value, so that a look can choose the threshold, and with it
the cover, when a frame is drawn; edges are sharp at any size of a frame, because the value is smooth and is compared
only after it has been interpolated. Sunlight is baked for `COVER_LIT`. Clouds do not drift and cast no shadows.

The map is the stereographic projection of the upper half of the sky: conformal, with texels of 0.15 degrees at the
horizon and 0.3 at the zenith. `thalweg.render.kernels.shading.clouds` is the look-up.

Sources: fractal fields by spectral synthesis, Saupe, in The Science of Fractal Images, 1988, section 2.5; a layer of
cloud as a height field over a flat base, Gardner: Visual Simulation of Clouds, SIGGRAPH 1985.
"""

from functools import cache, partial

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.core.compute.threads import run_in_threads

f4 = np.float32
SIDE = 768
"""Texels of the map along a side."""
TILE = 1024
"""Nodes of the field along a side; it repeats."""
TILE_KM = 8.0
"""Side of the field over the ground."""
BASE_KM, THICK_KM = 1.1, 0.65
"""Height of the cloud base, and greatest thickness of the layer."""
CIRRUS_KM = 7.0
"""Height of the cirrus."""
CIRRUS_TILE_KM = 60.0
STEPS, SLANT_STEPS, MOST_STEPS = 24, 9.0, 90
"""Steps of a ray through the layer: STEPS, plus SLANT_STEPS over the sine of its elevation, at most MOST_STEPS."""
SUN_STEPS = 5
"""Steps from a cloud towards the sun."""
RISE = 0.5
"""By how much the field exceeds the threshold where a cloud fills the whole layer."""
COVER_LIT = 0.4
"""Cover for which the sunlight on the clouds is computed."""
DENSITY = 30.0
"""Extinction of direct sunlight in a cloud, per kilometre and unit of the field's excess."""
SCATTERED = 0.35, 0.15
"""Share of the light that is scattered forwards, and of the extinction that it suffers."""
BILLOWS = (0.070, 0.11), (0.036, 0.07), (0.018, 0.035), (0.009, 0.012)
"""Wavelengths of a cloud's bulges as shares of the tile's side, and their weights."""
BULGE = 0.36
"""Greatest value that the bulges add to the field."""
SHEAR = (1.1, 0.35), (-0.75, -0.95)
"""Kilometres by which two layers of bulges shift for each kilometre of height: together they vary upwards as well."""
LOW, CLEAR = 0.055, 0.28
"""Sines of height above the horizon between which clouds come out of the haze."""


def _band(rng: np.random.Generator, wavelength: float, stretch: float = 1.0) -> np.ndarray:
    """Return a repeating Gaussian field [TILE, TILE] of zero mean and unit spread, with one dominant wavelength.

    wavelength: as a share of the tile's side; stretch: how much longer it is along the first axis.
    """
    spectrum = np.fft.rfft2(rng.standard_normal((TILE, TILE)))
    across = np.fft.rfftfreq(TILE, 1 / TILE)[None, :]
    along = np.fft.fftfreq(TILE, 1 / TILE)[:, None] * stretch
    octaves = np.log2(np.maximum(np.hypot(along, across), 1e-6) * wavelength)
    # A log-normal band, about an octave wide.
    field = np.fft.irfft2(spectrum * np.exp(-0.5 * (octaves / 0.45) ** 2), (TILE, TILE))
    return (field - field.mean()) / field.std()


def _ranked(field: np.ndarray) -> np.ndarray:
    """Return a field's ranks [TILE, TILE] float32 in 0..1: a share s of the area lies above 1 - s."""
    rank = np.empty(field.size, np.float32)
    rank[np.argsort(field, axis=None, kind="stable")] = np.linspace(0.0, 1.0, field.size, dtype=np.float32)
    return rank.reshape(field.shape)


@cache
def fields() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return repeating fields [TILE, TILE] float32: cumulus by rank, its billows, and cirrus by opacity in 0..1."""
    rng = np.random.default_rng(0xC10D)
    cumulus = 0.9 * _band(rng, 0.30) + 1.0 * _band(rng, 0.15)
    # Billows: folded noise has round crests and sharp creases, as cauliflower tops have.
    folded = [weight * (0.8 - np.abs(_band(rng, wavelength))) for wavelength, weight in BILLOWS]
    patches = np.clip(0.5 + 0.5 * _band(rng, 0.4), 0.0, 1.0)
    bands = [w * _band(rng, k, 4.0) for k, w in ((0.12, 1.0), (0.06, 0.8), (0.03, 0.6), (0.015, 0.4))]
    streaks = np.sum(bands, axis=0)
    cirrus = np.clip(0.35 + 0.3 * streaks, 0.0, 1.0) * patches
    return _ranked(cumulus), np.sum(folded, axis=0).astype(np.float32), cirrus.astype(np.float32)


@kernel(inlined=True, allocates=False)
def _field_at(field, x, y):
    """The value of a repeating field at coordinates in nodes, interpolated."""
    fx = np.floor(x)
    fy = np.floor(y)
    u = x - fx
    v = y - fy
    # The side is a power of two, so a mask wraps negative indices too.
    i = np.int64(fx) & (TILE - 1)
    j = np.int64(fy) & (TILE - 1)
    i1 = (i + 1) & (TILE - 1)
    j1 = (j + 1) & (TILE - 1)
    low = field[j, i] + (field[j, i1] - field[j, i]) * u
    high = field[j1, i] + (field[j1, i1] - field[j1, i]) * u
    return low + (high - low) * v


@kernel(inlined=True, allocates=False)
def _node_at(field, x, y):
    """The value of a repeating field at the nearest node."""
    return field[np.int64(np.floor(y + 0.5)) & (TILE - 1), np.int64(np.floor(x + 0.5)) & (TILE - 1)]


@kernel(inlined=True, allocates=False)
def _excess(field, billows, x, y, h, least):
    """By how much the field exceeds what a height h (0..1 of the layer) asks for at coordinates in nodes.

    Without its bulges where these could not lift it above `least`.
    """
    value = _field_at(field, x, y) - RISE * h * (0.5 + 0.5 * h)
    if value + BULGE > least:
        up = h * THICK_KM * (TILE / TILE_KM)
        value += _node_at(billows, x + SHEAR[0][0] * up, y + SHEAR[0][1] * up)
        # The second layer is turned by a right angle and shifted, so that the two never agree.
        value += _node_at(billows, 311.0 - y + SHEAR[1][0] * up, 127.0 + x + SHEAR[1][1] * up)
    return value


@kernel(fastmath=False, allocates=False)
def _meet_layer(field, billows, x, y, tx, ty, dz):
    """The greatest excess along a ray through the layer, and the height (0..1) at which a cloud is met or nearest.

    The ray starts below (x, y) in nodes and goes (tx, ty) nodes along the ground for a kilometre of height; dz is the
    sine of its elevation. The cloud is that of the nominal cover, `COVER_LIT`.
    """
    best = 0.0
    at = 0.0
    steps = min(STEPS + int(SLANT_STEPS / dz), MOST_STEPS)
    before = 0.0
    entered = False
    for k in range(steps + 1):
        h = k / steps
        reach = BASE_KM + h * THICK_KM
        value = _excess(field, billows, x + tx * reach, y + ty * reach, h, best)
        over = value - (1.0 - COVER_LIT)
        if not entered and over > 0.0:
            # Between two steps, by linear interpolation, so that the steps do not show in the light.
            at = h - (over / (over - before) / steps if k > 0 else 0.0)
        elif not entered and value > best:
            at = h
        entered = entered or over > 0.0
        before = over
        best = max(best, value)
    return best, at


@kernel(fastmath=False, allocates=False)
def _sunlight(field, billows, x, y, at, sx, sy, sun_up):
    """The share of sun that reaches a height `at` (0..1 of the layer) over (x, y) in nodes.

    The way to the sun goes (sx, sy) nodes along the ground for a kilometre of height; sun_up: sine of its elevation.
    """
    depth = 0.0
    rise = (1.0 - at) / SUN_STEPS
    for k in range(SUN_STEPS):
        h = at + (k + 0.5) * rise
        up = (k + 0.5) * rise * THICK_KM
        value = _excess(field, billows, x + sx * up, y + sy * up, h, 1.0 - COVER_LIT) - (1.0 - COVER_LIT)
        depth += DENSITY * max(value, 0.0) * rise * THICK_KM / sun_up
    # Two terms of Beer's law: what is scattered forwards goes on (Wrenninge, Kulla, Lundqvist 2013).
    return (1.0 - SCATTERED[0]) * np.exp(-depth) + SCATTERED[0] * np.exp(-SCATTERED[1] * depth)


@kernel(fastmath=False, allocates=False)
def _look_through(field, billows, cirrus, place, sun, excess, light, veil, first, last):
    """Fill rows first to last of the maps [SIDE, SIDE]: excess, share of sun, opacity of cirrus, all in 0..1.

    place: offset in nodes of the field (x, y) and its turn's cosine and sine; sun: unit vector.
    """
    nodes = TILE / TILE_KM
    # Limited: the way of a lower sun through the layer would be longer than the field's period.
    sun_up = max(sun[2], 0.15)
    sx = (sun[0] * place[2] - sun[1] * place[3]) / sun_up * nodes
    sy = (sun[0] * place[3] + sun[1] * place[2]) / sun_up * nodes
    stretch = TILE / CIRRUS_TILE_KM * CIRRUS_KM / nodes
    for row in range(first, last):
        for column in range(SIDE):
            px = (column + 0.5) / SIDE * 2.0 - 1.0
            py = (row + 0.5) / SIDE * 2.0 - 1.0
            square = px * px + py * py
            # Stereographic from the nadir: the circle of radius one is the horizon.
            dz = (1.0 - square) / (1.0 + square)
            if dz < 0.6 * LOW:
                continue
            # Kilometres along the ground for one of height, then nodes in the turned coordinates of the field.
            gx = 2.0 * px / (1.0 + square) / dz
            gy = 2.0 * py / (1.0 + square) / dz
            tx = (gx * place[2] - gy * place[3]) * nodes
            ty = (gx * place[3] + gy * place[2]) * nodes
            best, at = _meet_layer(field, billows, place[0], place[1], tx, ty, dz)
            reach = BASE_KM + at * THICK_KM
            excess[row, column] = best
            light[row, column] = _sunlight(
                field, billows, place[0] + tx * reach, place[1] + ty * reach, at, sx, sy, sun_up
            )
            t = min(max((dz - LOW) / (CLEAR - LOW), 0.0), 1.0)
            shown = t * t * (3.0 - 2.0 * t)
            veil[row, column] = _field_at(cirrus, place[1] + tx * stretch, place[0] + ty * stretch) * shown


def cloud_map(sun: np.ndarray, seed: int) -> np.ndarray:
    """Return the map [SIDE, SIDE, 4] float32 in 0..1 of the clouds over the world with a seed.

    Its channels are the field's excess, the share of sun that reaches the cloud, the opacity of the cirrus, and how
    much of the cumulus shows through the haze. Row and column run north and east. sun: unit vector [3].
    """
    cumulus, billows, cirrus = fields()
    rng = np.random.default_rng(np.random.SeedSequence([0xC10, seed]))
    turn = rng.uniform(0, 2 * np.pi)
    place = np.array([*rng.uniform(0, TILE, 2), np.cos(turn), np.sin(turn)])
    excess, light, veil = (np.zeros((SIDE, SIDE), np.float32) for _ in range(3))
    rows = partial(_look_through, cumulus, billows, cirrus, place, np.asarray(sun, np.float64), excess, light, veil)
    run_in_threads(SIDE, rows)
    middle = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    square = middle[:, None] ** 2 + middle[None, :] ** 2
    t = np.clip(((1 - square) / (1 + square) - LOW) / (CLEAR - LOW), 0.0, 1.0)
    return np.stack([excess, light, veil, t * t * (3 - 2 * t)], axis=-1).astype(np.float32)


def packed(clouds: np.ndarray) -> np.ndarray:
    """Return a map [SIDE, SIDE, 4] as texels [SIDE * SIDE] uint32, a byte a channel, the first lowest."""
    coded = np.rint(np.clip(clouds, 0.0, 1.0) * 255).astype(np.uint32)
    return (coded[..., 0] | coded[..., 1] << 8 | coded[..., 2] << 16 | coded[..., 3] << 24).ravel()
