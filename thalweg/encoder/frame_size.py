"""`FrameSize`: height and width of the frames that an encoder takes, one number for a square or a pair."""

from typing import Annotated, Any

from pydantic import BeforeValidator

LEAST_PX = 16
"""Least side of a frame, that of `thalweg.render.Camera`."""


def checked_size(size: Any) -> int | tuple[int, int]:
    """Return a frame's size as configs hold it: one number if height and width are the same, else both.

    Raises `ValueError` for what is neither a whole number from `LEAST_PX` nor a pair of them.
    """
    pair = (size, size) if isinstance(size, int) else tuple(size) if isinstance(size, list | tuple) else ()
    if len(pair) != 2 or any(type(side) is not int or side < LEAST_PX for side in pair):
        raise ValueError(f"it must be a whole number from {LEAST_PX}, or height and width, got {size!r:.80}")
    return pair[0] if pair[0] == pair[1] else (pair[0], pair[1])


FrameSize = Annotated[Any, BeforeValidator(checked_size)]
"""Height and width in pixels, as `checked_size` returns them."""


def sides(size: int | tuple[int, int]) -> tuple[int, int]:
    """Return height and width of a checked size."""
    return (size, size) if isinstance(size, int) else size


def halved(size: int | tuple[int, int], times: int) -> tuple[int, int]:
    """Return height and width of what so many convolutions of stride 2 make of a frame: each halves and rounds up."""
    height, width = sides(size)
    return -(-height // 2**times), -(-width // 2**times)
