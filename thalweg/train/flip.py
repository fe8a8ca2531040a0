"""Images seen in a mirror: left and right change places."""

import numpy as np


def flipped(images: np.ndarray) -> np.ndarray:
    """Return images [..., H, W, C] uint8 with their columns in the opposite order."""
    if images.shape[-1] == 4 and images.flags.c_contiguous:  # whole pixels are moved several times as fast as bytes
        return images.view(np.uint32)[..., ::-1, :].copy().view(np.uint8)
    return images[..., ::-1, :].copy()
