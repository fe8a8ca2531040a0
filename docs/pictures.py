"""Make the pictures of the documentation: `python docs/pictures.py`, a minute or two.

They are drawn by the package from its fixed rivers, so that a change of the look shows here.
"""

import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from thalweg.bench.gallery import gallery
from thalweg.env import sample_starts
from thalweg.render import Camera, Renderer
from thalweg.world import LEVELS, load_or_build
from thalweg.world.drawing import draw

IMAGES = Path(__file__).resolve().parent / "images"
GAP = 6
SEEN = {"Easy": (3, 6), "Medium": (7, 10, 13), "Hard": (6, 9, 14)}
"""Which of each level's first starts are shown."""
LOOKED_FROM = 10
"""Which start on Medium the looks are shown from."""


def main() -> None:
    IMAGES.mkdir(exist_ok=True)
    save(frames(), "frames.png")
    save(levels(), "levels.png")
    looks().save(IMAGES / "looks.jpg", quality=88)
    print("docs/images/looks.jpg")


def save(picture: Image.Image, name: str) -> None:
    """Write a picture with a palette, which is a third of the size and looks the same."""
    picture.quantize(256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.FLOYDSTEINBERG).save(IMAGES / name)
    print(f"docs/images/{name}")


def frames(size: int = 128, zoom: int = 2) -> Image.Image:
    """What the camera sees at eight starts, four and four, as policies see it each pixel drawn double."""
    views = []
    for level, chosen in SEEN.items():
        world = load_or_build(level)
        starts = sample_starts(world, max(chosen) + 1, 0)[list(chosen)]
        views.extend(Renderer([world], Camera(size, size)).render(starts))
    tiles = [view[..., :3].repeat(zoom, 0).repeat(zoom, 1) for view in views]
    return sheet(tiles, columns=4)


def looks(size: int = 128) -> Image.Image:
    """One view at both ends of each range of domain randomisation."""
    world = load_or_build("Medium")
    pose = sample_starts(world, LOOKED_FROM + 1, 0)[LOOKED_FROM]
    return gallery(world, pose, Camera(size, size))


def levels(width: int = 460) -> Image.Image:
    """The orthographic views of the three levels, side by side."""
    tiles = []
    with tempfile.TemporaryDirectory() as folder:
        for level in LEVELS:
            path = Path(folder) / f"{level}.png"
            draw(load_or_build(level), path, size_px=1000)
            with Image.open(path) as map_:
                height = round(map_.height * width / map_.width)
                tiles.append(np.asarray(map_.convert("RGB").resize((width, height), Image.Resampling.LANCZOS)))
    return sheet(tiles, columns=3)


def sheet(tiles: list[np.ndarray], columns: int) -> Image.Image:
    """Tiles [h, w, 3] uint8 in rows of `columns`, on white, each in a cell as large as the largest."""
    high, wide = (max(tile.shape[axis] for tile in tiles) for axis in (0, 1))
    rows = -(-len(tiles) // columns)
    board = np.full((rows * (high + GAP) - GAP, columns * (wide + GAP) - GAP, 3), 255, np.uint8)
    for k, tile in enumerate(tiles):
        y, x = k // columns * (high + GAP), k % columns * (wide + GAP)
        board[y : y + tile.shape[0], x : x + tile.shape[1]] = tile
    return Image.fromarray(board)


if __name__ == "__main__":
    main()
