"""Packing of colours into texels, as the kernels of `thalweg.render.kernels.table_lookup` unpack them."""

import numpy as np


def pack_colour(radiance: np.ndarray, scale: float, fourth: np.ndarray | None = None) -> np.ndarray:
    """Return radiance [..., 3] square-root coded over 0..scale, with a fourth byte [...], integers, as uint32 [...]."""
    coded = np.rint(np.sqrt(np.clip(radiance / scale, 0.0, 1.0)) * 255).astype(np.uint32)
    packed = coded[..., 0] | coded[..., 1] << 8 | coded[..., 2] << 16
    return packed if fourth is None else packed | fourth.astype(np.uint32) << 24
