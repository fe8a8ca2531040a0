"""How much is drawn? All of it, or what `thalweg.render.fast` leaves."""

from typing import Literal, get_args

Quality = Literal["full", "fast"]
QUALITIES: tuple[Quality, ...] = get_args(Quality)
