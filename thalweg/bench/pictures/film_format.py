"""Formats of films: size, share of the steps shown, and compression."""

from dataclasses import dataclass

MARGIN_PX = 16
BLOCK_PX = 16
"""Block size of H.264; sides should be multiples of it."""


@dataclass(frozen=True)
class FilmFormat:
    """Size and quality of a film; width and height must be multiples of `BLOCK_PX`."""

    view_px: int
    """Side of the camera's view."""
    map_px: int
    """Side of the map beside it."""
    inset_px: int
    """Side of the water mask within the view."""
    font_px: int
    """Size of the text above the map; a line that is too long makes it smaller."""
    every: int = 1
    """One step in so many is shown; the last step always is."""
    crf: int = 25
    """Constant rate factor of H.264: a greater one gives a smaller file and a worse picture."""

    def __post_init__(self) -> None:
        if any(side % BLOCK_PX for side in self.size_px):
            raise ValueError(f"a film of {self.size_px} pixels: width and height must be multiples of {BLOCK_PX}")

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the film."""
        return self.view_px + self.map_px + 3 * MARGIN_PX, self.view_px + 2 * MARGIN_PX

    def shown_steps(self, steps: int) -> list[int]:
        """Return the indices of the steps that are shown of a flight of `steps`, at least one."""
        return [*range(0, steps - 1, self.every), steps - 1]

    @property
    def map_left_px(self) -> int:
        """Left edge of the map, and of the text above it."""
        return self.view_px + 2 * MARGIN_PX

    @property
    def map_top_px(self) -> int:
        """Upper edge of the map, whose lower edge is that of the view."""
        return MARGIN_PX + self.view_px - self.map_px


LARGE = FilmFormat(view_px=384, map_px=288, inset_px=112, font_px=15)
SMALL = FilmFormat(view_px=224, map_px=160, inset_px=56, font_px=11, every=3, crf=30)
