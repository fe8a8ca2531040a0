"""Gradient noise on the nodes of a grid, summed over octaves.

A field is a sum of octaves of gradient noise (Perlin, 2002). Each octave has half the wavelength of the one before and
is rotated and shifted against it, so that no lattice shows. A field has zero mean and a standard deviation of about 1.
Octaves shorter than two nodes are left out: noise of single nodes would be noise of single pixels in a frame.
"""

import math
from functools import partial

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.core.compute.threads import run_in_threads

f4 = np.float32
OCTAVE_DEVIATION = 0.2157
"""Standard deviation of one octave with unit gradients; checked by a test."""
TURN = 0.65
"""Angle in radians by which each octave is rotated against the one before."""


@kernel(fastmath=False, disjoint=True)
def add_octave(out, origin, across, gradient, amplitude, first, last):
    """Add one octave of gradient noise to the rows first to last of out [GY, GX] float32.

    Node (i, j) lies at origin + (across[0] j - across[1] i, across[1] j + across[0] i), in wavelengths, inside the
    lattice of unit vectors gradient [rows, columns, 2] float32.
    """
    columns = out.shape[1]
    for i in range(first, last):
        x0 = origin[0] - across[1] * f4(i)
        y0 = origin[1] + across[0] * f4(i)
        for j in range(columns):
            x = x0 + across[0] * f4(j)
            y = y0 + across[1] * f4(j)
            # The origin keeps all coordinates positive, so truncation is floor; unsigned indices skip the wrap-around.
            ix = np.uint32(x)
            iy = np.uint32(y)
            fx = x - f4(ix)
            fy = y - f4(iy)
            # The quintic fade 6t⁵ - 15t⁴ + 10t³ has zero first and second derivatives at the lattice lines.
            sx = fx * fx * fx * (fx * (fx * f4(6.0) - f4(15.0)) + f4(10.0))
            sy = fy * fy * fy * (fy * (fy * f4(6.0) - f4(15.0)) + f4(10.0))
            gx = fx - f4(1.0)
            gy = fy - f4(1.0)
            # Contributions of the four corners: gradient · offset from the corner.
            a = gradient[iy, ix, 0] * fx + gradient[iy, ix, 1] * fy
            b = gradient[iy, ix + 1, 0] * gx + gradient[iy, ix + 1, 1] * fy
            c = gradient[iy + 1, ix, 0] * fx + gradient[iy + 1, ix, 1] * gy
            d = gradient[iy + 1, ix + 1, 0] * gx + gradient[iy + 1, ix + 1, 1] * gy
            low = a + sx * (b - a)
            high = c + sx * (d - c)
            out[i, j] += amplitude * (low + sy * (high - low))


def fractal(
    shape: tuple[int, int],
    cell_m: float,
    wavelength_m: float,
    octaves: int,
    rng: np.random.Generator,
    gain: float = 0.7,
) -> np.ndarray:
    """Return [GY, GX] float32 noise of mean 0 and standard deviation about 1.

    `wavelength_m` is its longest wavelength.

    `gain` is the ratio of the amplitudes of successive octaves: 0.5 gives smooth hills, 0.8 gives grain.
    """
    out = np.zeros(shape, np.float32)
    wavelengths = [wavelength_m / 2**k for k in range(octaves) if wavelength_m / 2**k >= 2.0 * cell_m]
    amplitudes = gain ** np.arange(len(wavelengths))
    amplitudes /= OCTAVE_DEVIATION * np.sqrt(np.sum(amplitudes**2))
    start = rng.uniform(0.0, 2.0 * math.pi)
    for k, (wavelength, amplitude) in enumerate(zip(wavelengths, amplitudes, strict=True)):
        angle = start + TURN * k
        across = np.array([math.cos(angle), math.sin(angle)]) * (cell_m / wavelength)
        # The rotated map must lie inside the lattice: its corners give the range of the coordinates.
        corners = np.array([(0, 0), (0, shape[1]), (shape[0], 0), shape], dtype=np.float64)
        x = across[0] * corners[:, 1] - across[1] * corners[:, 0]
        y = across[1] * corners[:, 1] + across[0] * corners[:, 0]
        origin = np.array([-x.min(), -y.min()]) + rng.uniform(0.5, 1.5, 2)
        size = np.ceil([np.ptp(y) + 4.0, np.ptp(x) + 4.0]).astype(int)
        # Row by row to save memory: under a long narrow map that is rotated lie many more gradients than nodes.
        gradient = np.empty((*size, 2), np.float32)
        for row in range(size[0]):
            turn = rng.uniform(0.0, 2.0 * math.pi, size[1])
            gradient[row, :, 0], gradient[row, :, 1] = np.cos(turn), np.sin(turn)
        octave = partial(add_octave, out, origin.astype(np.float32), across.astype(np.float32), gradient, f4(amplitude))
        run_in_threads(len(out), octave)
    return out


def smooth_step(low: float, high: float, x: np.ndarray) -> np.ndarray:
    """Return 0 where x [...] is below `low`, 1 above `high`, and 3t² - 2t³ between them."""
    t = np.clip((x - f4(low)) / f4(high - low), f4(0.0), f4(1.0))
    return t * t * (f4(3.0) - f4(2.0) * t)
