"""`Quality`: full, or the reduced quality called fast."""

from typing import Literal, get_args

Quality = Literal["full", "fast"]
QUALITIES: tuple[Quality, ...] = get_args(Quality)
