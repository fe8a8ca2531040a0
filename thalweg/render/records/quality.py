"""How much is drawn? All of it, or what `thalweg.render.kernels.shading.reduced_quality` leaves."""

from typing import Literal, get_args

Quality = Literal["full", "fast"]
QUALITIES: tuple[Quality, ...] = get_args(Quality)
