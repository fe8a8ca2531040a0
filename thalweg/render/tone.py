"""How does radiance become a picture? Automatic exposure, a filmic curve, and the code of sRGB.

Exposure sets the frame's mean luminance, as the original's does (its frames differ by 8 % only). The curve is that of
Narkowicz, "ACES Filmic Tone Mapping Curve", 2015; the code that of IEC 61966-2-1.
"""

import numpy as np
from numba import int32, uint32

from thalweg.kernel import kernel

f32 = np.float32

KEY = 0.135
"""Mean luminance that exposure aims at, before the curve."""
ADAPTION = 0.85
"""Share of a frame's deviation from the key that exposure takes away."""
LUMA = (0.2126, 0.7152, 0.0722)
SATURATION = 1.12
"""Factor on the distance of each colour from grey, before the curve, which pales colours."""
BRIGHTEST = 3.0
"""Pixels count for the exposure up to this radiance: glitter does not darken the picture."""
CODES = 4096


def curve(radiance: np.ndarray) -> np.ndarray:
    """Display light 0..1 for exposed radiance."""
    x = radiance
    return np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0)


def encode(light: np.ndarray) -> np.ndarray:
    """sRGB 0..1 for display light 0..1."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)


def code_table() -> np.ndarray:
    """[CODES] uint8 for exposed radiance spaced as its square root over 0..4."""
    root = np.arange(CODES) / (CODES - 1) * 2
    return np.rint(encode(curve(root**2)) * 255).astype(np.uint8)


_TABLE = code_table().astype(np.uint32)


@kernel(disjoint=True)
def develop(red, green, blue, wet, image, width):
    """Expose radiance [H, W'] and write it to image [H, W] uint32: red, green, blue, and wet [H, W'] uint8 on top."""
    height = red.shape[0]
    total = f32(0)
    for r in range(height):
        row = f32(0)
        for c in range(width):
            luma = f32(LUMA[0]) * red[r, c] + f32(LUMA[1]) * green[r, c] + f32(LUMA[2]) * blue[r, c]
            row += min(luma, f32(BRIGHTEST))
        total += row
    mean = max(total / f32(height * width), f32(1e-4))
    gain = (f32(KEY) / mean) ** f32(ADAPTION)
    scale = f32((CODES - 1) / 2.0)
    top = f32(CODES - 1)
    for r in range(height):
        for c in range(width):
            luma = f32(LUMA[0]) * red[r, c] + f32(LUMA[1]) * green[r, c] + f32(LUMA[2]) * blue[r, c]
            grey = luma * f32(1 - SATURATION)
            x = max(red[r, c] * f32(SATURATION) + grey, f32(0)) * gain
            y = max(green[r, c] * f32(SATURATION) + grey, f32(0)) * gain
            z = max(blue[r, c] * f32(SATURATION) + grey, f32(0)) * gain
            a = _TABLE[uint32(int32(min(np.sqrt(x) * scale + f32(0.5), top)))]
            b = _TABLE[uint32(int32(min(np.sqrt(y) * scale + f32(0.5), top)))]
            d = _TABLE[uint32(int32(min(np.sqrt(z) * scale + f32(0.5), top)))]
            image[r, c] = a | (b << uint32(8)) | (d << uint32(16)) | (uint32(wet[r, c]) << uint32(24))
