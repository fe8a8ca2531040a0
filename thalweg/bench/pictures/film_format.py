"""How large is a film? Width, height, how much of a flight it shows, and how well."""

from dataclasses import dataclass

MARGIN_PX = 16
BLOCK_PX = 16
"""Of H.264, which likes sides that are multiples of it."""


@dataclass(frozen=True)
class Format:
    """How large a film is; width and height must be multiples of `BLOCK_PX`."""

    view_px: int
    """Side of the camera's view."""
    map_px: int
    """Side of the map beside it."""
    inset_px: int
    """Side of the water mask within the view."""
    font_px: int
    """Of the lines below the map, unless one is too long."""
    every: int = 1
    """Of so many steps one is shown; the last step always is."""
    crf: int = 25
    """Of H.264: the greater the smaller the file, and the worse the picture."""

    def __post_init__(self) -> None:
        if any(side % BLOCK_PX for side in self.size_px):
            raise ValueError(f"a film of {self.size_px} pixels; both must be multiples of {BLOCK_PX}")

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.view_px + self.map_px + 3 * MARGIN_PX, self.view_px + 2 * MARGIN_PX

    def shown(self, steps: int) -> list[int]:
        """Which of so many steps, of which there must be one, are shown."""
        return [*range(0, steps - 1, self.every), steps - 1]

    @property
    def beside_px(self) -> int:
        """Where what stands beside the view begins."""
        return self.view_px + 2 * MARGIN_PX


LARGE = Format(view_px=384, map_px=288, inset_px=112, font_px=15)
SMALL = Format(view_px=224, map_px=160, inset_px=56, font_px=11, every=3, crf=30)
