"""Contact sheets: many frames in one picture, each above its water mask."""

import math

import numpy as np
from PIL import Image

GAP_PX = 4


def contact_sheet(frames: np.ndarray, columns: int = 8) -> Image.Image:
    """Return a picture of frames uint8 [N, H, W, 4] (red, green, blue, mask), in rows of at most `columns`."""
    count, height, width, _ = frames.shape
    columns = min(columns, count)
    cell_h, cell_w = 2 * height + 2 * GAP_PX, width + GAP_PX
    picture = np.full((math.ceil(count / columns) * cell_h - GAP_PX, columns * cell_w - GAP_PX, 3), 255, np.uint8)
    for index, frame in enumerate(frames):
        top, left = index // columns * cell_h, index % columns * cell_w
        picture[top : top + height, left : left + width] = frame[..., :3]
        below = top + height + GAP_PX // 2
        picture[below : below + height, left : left + width] = frame[..., 3:]
    return Image.fromarray(picture)
