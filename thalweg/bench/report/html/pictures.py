"""Small copies of a report's figures for its page; the files beside the page keep every bit."""

import io
from dataclasses import dataclass

from PIL import Image

COLOURS = 256
"""Colours of a plot on the page: with its text and its smoothed lines it hardly has more."""
QUALITY = 85
"""JPEG quality of photographic pictures."""


@dataclass(frozen=True)
class SmallPicture:
    """An encoded picture."""

    content: bytes
    media_type: str
    size_px: tuple[int, int]
    """Width and height."""


def for_the_page(png: bytes, *, photographic: bool = False) -> SmallPicture:
    """Return a small copy of a picture, with as many pixels.

    A plot becomes a PNG with a palette of at most `COLOURS`, a `photographic` picture a JPEG.
    """
    picture, written = Image.open(io.BytesIO(png)).convert("RGB"), io.BytesIO()
    if photographic:
        picture.save(written, "JPEG", quality=QUALITY, optimize=True)
        return SmallPicture(written.getvalue(), "image/jpeg", picture.size)
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(written, "PNG", optimize=True)
    return SmallPicture(written.getvalue(), "image/png", picture.size)
