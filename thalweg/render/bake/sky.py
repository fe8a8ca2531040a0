"""Radiance of the sky in each direction: Preetham's daylight model, and distant wooded hills along the horizon.

The sky is baked once per world into a small map, so that a pixel of sky or of its reflection is one look-up. There is
no disc of the sun; the shading of water adds the sun's glitter, and `thalweg.render.bake.clouds` has the clouds.

Source: Preetham, Shirley, Smits: A Practical Analytic Model for Daylight, SIGGRAPH 1999, section 3 and appendix A.2.
"""

import math

import numpy as np

ROWS = 64
COLUMNS = 512
TURBIDITY = 2.2
SCALE_KCD = 40.0
"""Luminance in kcd/m² that counts as radiance one: a white surface in full sun has about 25, and the original's sky is
dimmer beside its sand than nature's."""
CODE_RANGE = 2.0
"""Radiances up to this are stored in the map, square-root coded."""

_PEREZ_SLOPE = np.array(
    [
        [0.1787, -0.3554, -0.0227, 0.1206, -0.0670],
        [-0.0193, -0.0665, -0.0004, -0.0641, -0.0033],
        [-0.0167, -0.0950, -0.0079, -0.0441, -0.0109],
    ]
)
_PEREZ_BASE = np.array(
    [
        [-1.4630, 0.4275, 5.3251, -2.5771, 0.3703],
        [-0.2592, 0.0008, 0.2125, -0.8989, 0.0452],
        [-0.2608, 0.0092, 0.2102, -1.6537, 0.0529],
    ]
)
_ZENITH_X = np.array(
    [
        [0.00166, -0.00375, 0.00209, 0.0],
        [-0.02903, 0.06377, -0.03202, 0.00394],
        [0.11693, -0.21196, 0.06052, 0.25886],
    ]
)
_ZENITH_Y = np.array(
    [
        [0.00275, -0.00610, 0.00317, 0.0],
        [-0.04214, 0.08970, -0.04153, 0.00516],
        [0.15346, -0.26756, 0.06670, 0.26688],
    ]
)
_XYZ_TO_RGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])


def daylight(directions: np.ndarray, sun: np.ndarray, turbidity: float = TURBIDITY) -> np.ndarray:
    """Return the clear-sky radiance [..., 3] from unit directions [..., 3], linear RGB in units of `SCALE_KCD`.

    sun: unit vector [3].
    """
    cos_zenith = np.maximum(directions[..., 2], 0.02)
    gamma = np.arccos(np.clip(directions @ sun, -1.0, 1.0))
    theta_sun = math.acos(float(np.clip(sun[2], -1.0, 1.0)))

    chi = (4 / 9 - turbidity / 120) * (math.pi - 2 * theta_sun)
    luminance = (4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192
    powers_t = np.array([turbidity**2, turbidity, 1.0])
    powers_theta = np.array([theta_sun**3, theta_sun**2, theta_sun, 1.0])
    zenith = np.array([luminance, powers_t @ _ZENITH_X @ powers_theta, powers_t @ _ZENITH_Y @ powers_theta])

    perez = _PEREZ_SLOPE * turbidity + _PEREZ_BASE

    def shape(coefficients: np.ndarray, cos_theta: np.ndarray | float, angle: np.ndarray | float) -> np.ndarray:
        a, b, c, d, e = coefficients
        return (1 + a * np.exp(b / cos_theta)) * (1 + c * np.exp(d * angle) + e * np.cos(angle) ** 2)

    lum, x, y = (zenith[i] * shape(perez[i], cos_zenith, gamma) / shape(perez[i], 1.0, theta_sun) for i in range(3))
    xyz = np.stack([x / y * lum, lum, (1 - x - y) / y * lum], axis=-1)
    return np.maximum(xyz @ _XYZ_TO_RGB.T, 0.0) / SCALE_KCD


def map_directions() -> np.ndarray:
    """Return unit vectors [ROWS, COLUMNS, 3] towards the texels of the sky map.

    `thalweg.render.kernels.table_lookup.sky_at` is the look-up.

    Rows are spaced as the root of the height's sine, so that the horizon is finest; columns as the diamond angle.
    """
    row = (np.arange(ROWS) + 0.5) / ROWS * 2 - 1
    sine = np.sign(row) * row**2
    turn = (np.arange(COLUMNS) + 0.5) / COLUMNS * 4
    east = np.where(turn < 2, 1 - turn, turn - 3)
    north = np.where(turn < 1, turn, np.where(turn < 3, 2 - turn, turn - 4))
    flat = np.stack([east, north], axis=-1)
    flat /= np.linalg.norm(flat, axis=-1, keepdims=True)
    level = np.sqrt(1 - sine**2)
    return np.concatenate(
        [level[:, None, None] * flat[None], np.broadcast_to(sine[:, None, None], (ROWS, COLUMNS, 1))], axis=-1
    )


def haze(sun: np.ndarray) -> np.ndarray:
    """Return the colour [3] of distant haze: the mean of the sky a little above the horizon."""
    turn = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    height = 0.06
    level = math.sqrt(1 - height**2)
    ring = np.stack([level * np.cos(turn), level * np.sin(turn), np.full_like(turn, height)], axis=-1)
    return daylight(ring, sun).mean(axis=0)


def sky_map(sun: np.ndarray, seed: int) -> np.ndarray:
    """Return the radiance [ROWS, COLUMNS, 3] float64 of the sky and of the hills along its horizon.

    sun: unit vector [3].
    """
    directions = map_directions()
    sky = daylight(directions, sun)
    fog = haze(sun)
    # The sky fades into the haze towards the horizon.
    pale = np.exp(-np.maximum(directions[..., 2], 0.0) / 0.05)[..., None] * 0.6
    sky = sky * (1 - pale) + fog * pale

    rng = np.random.default_rng(np.random.SeedSequence([0x5C1, seed]))
    for distance, height, detail, colour in (
        (0.80, 0.040, 9, (0.055, 0.070, 0.050)),
        (0.55, 0.024, 40, (0.040, 0.052, 0.028)),
    ):
        crest = _crest(rng, detail) * height
        hill = np.array(colour) * (1 - distance) + fog * distance
        edge = 0.0025
        share = np.clip((crest[None, :] - directions[..., 2]) / edge + 0.5, 0.0, 1.0)[..., None]
        sky = sky * (1 - share) + hill * share
    return sky


def _crest(rng: np.random.Generator, detail: int) -> np.ndarray:
    """Return a closed outline [COLUMNS] in 0..1, a sum of `detail` harmonics with falling amplitudes."""
    turn = np.arange(COLUMNS) / COLUMNS * 2 * np.pi
    frequency = np.arange(1, detail + 1)
    phase = rng.uniform(0, 2 * np.pi, detail)
    weight = rng.normal(size=detail) / np.sqrt(frequency)
    outline = (weight[:, None] * np.cos(frequency[:, None] * turn + phase[:, None])).sum(axis=0)
    low, high = outline.min(), outline.max()
    return (outline - low) / max(high - low, 1e-9) * 0.8 + 0.2
