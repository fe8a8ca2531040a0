"""Tone mapping: kernels that turn radiance into sRGB by automatic exposure and a filmic curve, and add sensor noise.

Exposure sets the frame's mean luminance, as the original's does (its frames differ by 8 % only). The curve is that of
Narkowicz, "ACES Filmic Tone Mapping Curve", 2015; the encoding is that of IEC 61966-2-1.
"""

import math

import numpy as np
from numba import int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.records.appearance import GAIN_B, GAIN_G, GAIN_R, NOISE

f32 = np.float32

KEY = 0.142
"""Mean luminance that exposure aims at, before the curve."""
ADAPTATION = 0.85
"""Share of a frame's deviation from the key that exposure takes away."""
LUMA = (0.2126, 0.7152, 0.0722)
"""Weights of red, green and blue in the luminance: Rec. 709."""
SATURATION = 1.12
"""Factor on the distance of each colour from grey, before the curve, which pales colours."""
BRIGHTEST = 3.0
"""Greatest luminance that counts for the exposure, so that glitter does not darken the image."""
CODES = 4096
"""Entries of the table that stands for curve and encoding."""
NOISE_UNIT = 147.80
"""Standard deviation of the sum of four random bytes."""


def curve(radiance: np.ndarray) -> np.ndarray:
    """Return the display light 0..1 of exposed radiance."""
    x = radiance
    return np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0)


def encode(light: np.ndarray) -> np.ndarray:
    """Return the sRGB value 0..1 of display light 0..1."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)


def code_table() -> np.ndarray:
    """Return the code [CODES] uint8 of exposed radiance, spaced as its square root over 0..4."""
    root = np.arange(CODES) / (CODES - 1) * 2
    return np.rint(encode(curve(root**2)) * 255).astype(np.uint8)


CODE_TABLE = code_table().astype(np.uint32)
"""[CODES] uint32."""


@kernel(inlined=True, allocates=False)
def luminance(red, green, blue):
    """Return the luminance of a radiance."""
    return f32(LUMA[0]) * red + f32(LUMA[1]) * green + f32(LUMA[2]) * blue


@kernel(inlined=True, allocates=False)
def exposure(mean):
    """Return the factor on radiance in a frame of this mean luminance."""
    # A dark frame stays darker and a bright one brighter than the key, as an eye that adapts in part.
    return (f32(KEY) / max(mean, f32(1e-4))) ** f32(ADAPTATION)


@kernel(inlined=True, allocates=False)
def tone_pixel(table, red, green, blue, gain_r, gain_g, gain_b, top_byte):
    """Return radiance as a packed pixel: sRGB by the table of codes, with one more byte on top."""
    # Saturation moves each colour away from grey, before the curve, which pales colours.
    grey = luminance(red, green, blue) * f32(1 - SATURATION)
    x = max(red * f32(SATURATION) + grey, f32(0)) * gain_r
    y = max(green * f32(SATURATION) + grey, f32(0)) * gain_g
    z = max(blue * f32(SATURATION) + grey, f32(0)) * gain_b
    # The table is spaced as the root of the radiance, so that dark tones have as many entries as bright ones.
    scale = f32((CODES - 1) / 2.0)
    most = f32(CODES - 1)
    a = table[uint32(int32(clamp(math.sqrt(x) * scale + f32(0.5), f32(0), most)))]
    b = table[uint32(int32(clamp(math.sqrt(y) * scale + f32(0.5), f32(0), most)))]
    c = table[uint32(int32(clamp(math.sqrt(z) * scale + f32(0.5), f32(0), most)))]
    return a | (b << uint32(8)) | (c << uint32(16)) | (uint32(top_byte) << uint32(24))


@kernel(inlined=True, allocates=False)
def scramble(key):
    """Return a 32-bit hash of a 32-bit key. Source: Wellons, "Prospecting for Hash Functions", 2018, lowbias32."""
    key = uint32((key ^ (key >> uint32(16))) * uint32(0x7FEB352D))
    key = uint32((key ^ (key >> uint32(15))) * uint32(0x846CA68B))
    return uint32(key ^ (key >> uint32(16)))


@kernel(inlined=True, allocates=False)
def noisy(pixel, spread, key):
    """Return a packed pixel with sensor noise of a standard deviation `spread` in 255ths added to red, green and blue.

    The noise is the sum of the four bytes of a hash, which is nearly Gaussian.
    """
    result = pixel & uint32(0xFF000000)
    # A key for each channel, so that the noise is coloured as a sensor's is.
    for shift in (0, 8, 16):
        bits = scramble(uint32(key + uint32(shift)))
        total = int32(bits & uint32(255)) + int32((bits >> uint32(8)) & uint32(255))
        total += int32((bits >> uint32(16)) & uint32(255)) + int32(bits >> uint32(24))
        old = f32(int32((pixel >> uint32(shift)) & uint32(255)))
        new = clamp(old + spread * (f32(total) - f32(510)) * f32(1 / NOISE_UNIT) + f32(0.5), f32(0), f32(255))
        result = result | (uint32(int32(new)) << uint32(shift))
    return result


@kernel(disjoint=True, allocates=False)
def write_image(radiance, mask, look, key, image):
    """Expose `Radiance` [H', W'] and write it to image [H, W] uint32, with mask [H', W'] uint8 in the top byte.

    key: uint32 that the sensor's noise depends on.
    """
    red, green, blue = radiance
    height, width = image.shape
    total = f32(0)
    for r in range(height):
        # A sum for each row keeps the error of float32 small.
        row = f32(0)
        for c in range(width):
            row += min(luminance(red[r, c], green[r, c], blue[r, c]), f32(BRIGHTEST))
        total += row
    gain = exposure(total / f32(height * width))
    gain_r = gain * look[GAIN_R]
    gain_g = gain * look[GAIN_G]
    gain_b = gain * look[GAIN_B]
    for r in range(height):
        for c in range(width):
            image[r, c] = tone_pixel(CODE_TABLE, red[r, c], green[r, c], blue[r, c], gain_r, gain_g, gain_b, mask[r, c])
    # A second pass: the common case without noise stays free of its hash.
    if look[NOISE] > f32(0):
        for r in range(height):
            for c in range(width):
                image[r, c] = noisy(image[r, c], look[NOISE], scramble(uint32(key + uint32(r * width + c))))
