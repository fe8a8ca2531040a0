"""Formats of films: size, share of the steps shown, and compression."""

from dataclasses import dataclass, replace

from thalweg.bench.csv_files import ResultsError
from thalweg.render import Camera

MARGIN_PX = 16
BLOCK_PX = 16
"""Block size of H.264, of which the sides of a film are multiples."""
MOST_WIDE = 4
"""Greatest width of a camera's frame as a multiple of its height."""
FILM_COMMENT = "thalweg film"
"""Comment in the metadata of films, by which they are told from videos of a camera."""


@dataclass(frozen=True)
class FilmFormat:
    """Size and quality of a film; width and height are multiples of `BLOCK_PX`."""

    view_px: int
    """Height of the camera's view."""
    map_px: int
    """Side of the map beside it."""
    inset_px: int
    """Height of the water mask within the view."""
    font_px: int
    """Size of the text above the map; a line that is too long makes it smaller."""
    every: int = 1
    """One step in so many is shown; the last step always is."""
    crf: int = 25
    """Constant rate factor of H.264: a greater one gives a smaller file and a worse picture."""
    view_width_px: int | None = None
    """Width of the camera's view; None: a square."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the film."""
        width = self.view_size_px[0] + self.map_px + 3 * MARGIN_PX
        height = self.view_px + 2 * MARGIN_PX
        return -(-width // BLOCK_PX) * BLOCK_PX, -(-height // BLOCK_PX) * BLOCK_PX

    @property
    def view_size_px(self) -> tuple[int, int]:
        """Width and height of the camera's view."""
        return self.view_width_px or self.view_px, self.view_px

    @property
    def inset_size_px(self) -> tuple[int, int]:
        """Width and height of the water mask within the view, of the shape of the view."""
        width, height = self.view_size_px
        return max(round(self.inset_px * width / height), 1), self.inset_px

    def shown_steps(self, steps: int) -> list[int]:
        """Return the indices of the steps that are shown of a flight of `steps`, at least one."""
        return [*range(0, steps - 1, self.every), steps - 1]

    @property
    def map_left_px(self) -> int:
        """Left edge of the map, and of the text above it."""
        return self.view_size_px[0] + 2 * MARGIN_PX

    @property
    def map_top_px(self) -> int:
        """Upper edge of the map, whose lower edge is that of the view."""
        return MARGIN_PX + self.view_px - self.map_px


LARGE = FilmFormat(view_px=384, map_px=288, inset_px=112, font_px=15)
SMALL = FilmFormat(view_px=224, map_px=160, inset_px=56, font_px=11, every=3, crf=30)


def format_of(camera: Camera) -> FilmFormat:
    """Return `LARGE` in the size of a camera's frames, which are enlarged where they are lower than its view.

    Raises `ResultsError` for frames that are more than `MOST_WIDE` times as wide as high, or as high as wide.
    """
    height, width = camera.height_px, camera.width_px
    if max(height, width) > MOST_WIDE * min(height, width):
        raise ResultsError(
            f"a film needs frames of which one side is at most {MOST_WIDE} times the other, not {height} x {width}"
            " pixels (height x width)"
        )
    view = max(height, LARGE.view_px)
    scale = view / LARGE.view_px
    return replace(
        LARGE,
        view_px=view,
        map_px=round(scale * LARGE.map_px),
        inset_px=round(scale * LARGE.inset_px),
        font_px=round(scale * LARGE.font_px),
        view_width_px=round(width * view / height),
    )
