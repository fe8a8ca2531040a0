"""Pictures of the documentation: `python docs/pictures.py` draws them in a few minutes.

The package renders them from its fixed rivers and a real one, so they show how it looks now.
"""

import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from thalweg.bench.pictures.gallery import gallery
from thalweg.env import EnvConfig, RiverVectorEnv, sample_starts
from thalweg.env.pilot.flight_poses import FLIGHT_STEPS, pilot_poses
from thalweg.render import Camera, Renderer
from thalweg.render.records.props import PropKind
from thalweg.render.records.quality import QUALITIES
from thalweg.world import LEVELS, World, load_or_build
from thalweg.world.banks import KINDS
from thalweg.world.levels import on_banks
from thalweg.world.map_image import draw, size_in_scale

IMAGES = Path(__file__).resolve().parent / "images"
CAM = Path(__file__).resolve().parents[1] / "thalweg" / "world" / "real" / "rivers" / "cam.geojson"
GAP = 6
STARTS = {"Easy": (3, 6), "Medium": (7, 10, 13), "Hard": (6, 9, 14)}
"""Indices of the starts that are shown for each level."""
LOOK_START = 10
"""Index of the start on Medium from which the looks are shown."""
PROP_SAMPLES = (30, 118, 208)
"""Samples of the river of Medium above which the camera of the picture of props is."""
PROP_PLACES = (
    (PropKind.SWIMMER, 7.0, 0.15), (PropKind.BUOY, 10.0, -0.2), (PropKind.KAYAK, 14.0, 0.05),
    (PropKind.STATION, 15.0, 0.5), (PropKind.SWIMMER, 19.0, -0.2), (PropKind.BUOY, 24.0, 0.25),
    (PropKind.KAYAK, 30.0, -0.1), (PropKind.BUOY, 38.0, 0.2),
)  # fmt: skip
"""Kinds of props, their distances along the river in metres, and their places across it as shares of its width."""

BANK_SAMPLES = (30, 118, 208)
"""Samples of the river of Medium above which the cameras of the picture of banks are."""

CLASS_COLOURS = np.array(
    [
        [200, 220, 240], [40, 90, 200], [150, 120, 80], [40, 130, 50], [220, 60, 60],
        [250, 150, 60], [180, 40, 120], [240, 220, 40], [110, 110, 120],
    ],
    np.uint8,
)  # fmt: skip
"""Colour in which each class is shown, in the order of `thalweg.render.records.classes.CLASSES`."""
DEPTHS_M = (2.0, 100.0)
"""Depths that are shown black and white, with logarithms between them."""


def main() -> None:
    IMAGES.mkdir(exist_ok=True)
    save(frames(), "frames.png")
    save(parts(), "parts.png")
    save(levels(), "levels.png")
    save(qualities(), "qualities.png")
    drawn = ((looks(), "looks.jpg"), (real_river(), "cam.jpg"), (flights(), "flights.jpg"), (props(), "props.jpg"))
    for picture, name in drawn:
        picture.save(IMAGES / name, quality=88)
        print(f"docs/images/{name}")
    banks().save(IMAGES / "banks.jpg", quality=74)
    print("docs/images/banks.jpg")


def save(picture: Image.Image, name: str) -> None:
    """Save a picture with a palette, which takes a third of the space and looks the same."""
    picture.quantize(256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.FLOYDSTEINBERG).save(IMAGES / name)
    print(f"docs/images/{name}")


def frames(size: int = 128, zoom: int = 2) -> Image.Image:
    """Return the camera's views at eight starts in two rows, as policies see them, enlarged `zoom` times."""
    views = []
    for level, chosen in STARTS.items():
        world = load_or_build(level)
        starts = sample_starts(world, max(chosen) + 1, 0)[list(chosen)]
        views.extend(Renderer([world], Camera(size, size)).render(starts))
    tiles = [view[..., :3].repeat(zoom, 0).repeat(zoom, 1) for view in views]
    return tile_grid(tiles, columns=4)


def parts(size: int = 128, zoom: int = 2) -> Image.Image:
    """Return colours, water mask, depth and class of two starts, enlarged `zoom` times; the sky has no depth and is
    white."""
    world, chosen = load_or_build("Medium"), [STARTS["Medium"][0], STARTS["Medium"][2]]
    seen = Renderer([world], Camera(size, size)).render_layers(sample_starts(world, max(chosen) + 1, 0)[chosen])
    low, high = np.log(DEPTHS_M)
    shade = np.clip((np.log(np.maximum(seen.depth_m, 1e-3)) - low) / (high - low), 0, 1)
    grey = np.where(seen.depth_m < 0, 255, 255 * shade).astype(np.uint8)
    tiles = []
    for n in range(len(chosen)):
        mask, depth = (channel[..., None].repeat(3, -1) for channel in (seen.mask[n] * np.uint8(255), grey[n]))
        tiles += [seen.rgb[n], mask, depth, CLASS_COLOURS[seen.class_id[n]]]
    return tile_grid([tile.repeat(zoom, 0).repeat(zoom, 1) for tile in tiles], columns=4)


def looks(size: int = 128) -> Image.Image:
    """Return one view at both ends of each range of domain randomisation."""
    world = load_or_build("Medium")
    pose = sample_starts(world, LOOK_START + 1, 0)[LOOK_START]
    return gallery(world, pose, Camera(size, size))


def props(size: int = 384) -> Image.Image:
    """Return props of each kind on Medium, from three, five and eight metres above the water."""
    river = load_or_build("Medium").river
    poses, rows = [], []
    for number, (sample, height) in enumerate(zip(PROP_SAMPLES, (3.0, 5.0, 8.0), strict=True)):
        rng = np.random.default_rng(number)
        (x, y), (east, north) = river.position_m[sample], river.tangent[sample]
        poses.append([x, y, river.level_m[sample] + height, np.arctan2(north, east)])
        here = []
        for kind, distance, side in PROP_PLACES:
            at = int(np.searchsorted(river.arc_m, river.arc_m[sample] + distance)) % len(river.arc_m)
            left = np.array([-river.tangent[at][1], river.tangent[at][0]])
            place = river.position_m[at] + left * side * river.width_m[at]
            yaw = np.arctan2(-left[1] * side, -left[0] * side) if kind == PropKind.STATION else rng.uniform(-3, 3)
            here.append([kind, *place, river.level_m[at], yaw, rng.uniform(0, 6)])
        rows.append(here)
    frames = Renderer([load_or_build("Medium")], Camera(size, size)).render(poses, time_s=2.0, props=rows)
    return tile_grid([frame[..., :3] for frame in frames], columns=3)


def banks(size: int = 256) -> Image.Image:
    """Return each kind of banks on Medium in a column, from two, five and ten metres above the water."""
    columns = []
    for kind in KINDS:
        world = load_or_build(on_banks("Medium", kind))
        river, poses = world.river, []
        for sample, height in zip(BANK_SAMPLES, (2.0, 5.0, 10.0), strict=True):
            (x, y), (east, north) = river.position_m[sample], river.tangent[sample]
            poses.append([x, y, river.level_m[sample] + height, np.arctan2(north, east)])
        columns.append([frame[..., :3] for frame in Renderer([world], Camera(size, size)).render(poses, time_s=2.0)])
    return tile_grid([column[row] for row in range(len(BANK_SAMPLES)) for column in columns], columns=len(KINDS))


def flights(size: int = 128) -> Image.Image:
    """Return every twentieth frame of ten flights of the pilot on Medium, eight in a row."""
    world = load_or_build("Medium")
    poses = pilot_poses(world, 10 * FLIGHT_STEPS, 7)[10::20][:24]
    return tile_grid([view[..., :3] for view in Renderer([world], Camera(size, size)).render(poses)], columns=8)


def qualities(size: int = 128, zoom: int = 2) -> Image.Image:
    """Return four starts in full quality and below them in the fast one, enlarged `zoom` times."""
    world = load_or_build("Medium")
    poses = sample_starts(world, max(STARTS["Medium"]) + 1, 0)[[0, *STARTS["Medium"]]]
    views = [view for name in QUALITIES for view in Renderer([world], Camera(size, size), name).render(poses)]
    return tile_grid([view[..., :3].repeat(zoom, 0).repeat(zoom, 1) for view in views], columns=4)


def levels(width: int = 1392, finer: int = 2) -> Image.Image:
    """Return the orthographic views of the three levels side by side, all in one scale; drawn `finer` and reduced."""
    worlds = [load_or_build(level) for level in LEVELS]
    wide_m = [world.ground_m.shape[1] * world.grid.cell_m for world in worlds]
    px_per_m = finer * (width - (len(worlds) - 1) * GAP) / sum(wide_m)
    maps = []
    with tempfile.TemporaryDirectory() as folder:
        for world in worlds:
            path = Path(folder) / f"{world.name}.png"
            draw(world, path, size_px=size_in_scale(world, px_per_m))
            with Image.open(path) as map_:
                maps.append(map_.convert("RGB").reduce(finer))
    return row(maps, width)


def row(pictures: list[Image.Image], width: int) -> Image.Image:
    """Return pictures side by side on their lower edges, with gaps between them, as wide as asked for."""
    board = Image.new("RGB", (width, max(picture.height for picture in pictures)), "white")
    left = 0
    for picture in pictures:
        board.paste(picture, (left, board.height - picture.height))
        left += picture.width + GAP
    return board


def real_river(size: int = 128, zoom: int = 2, count: int = 9) -> Image.Image:
    """Return a map of the Cam, and the pilot's views at even intervals from one end to the other."""
    world = World.from_file(CAM)
    river = world.river
    env = RiverVectorEnv(world, 1, EnvConfig(observation="none"))
    east, north = river.tangent[0]
    env.reset(seed=0, options={"pose": [[*river.position_m[0], river.level_m[0] + 4.0, np.arctan2(north, east)]]})
    poses, ended = [], False
    while not ended:
        _, _, terminated, truncated, info = env.step(env.pilot_actions())
        poses.append(info["pose"][0])
        ended = bool(terminated[0] or truncated[0])
    chosen = np.array(poses)[np.linspace(0, len(poses), count, endpoint=False).astype(int)]
    views = Renderer([world], Camera(size, size)).render(chosen)
    flight = tile_grid([view[..., :3].repeat(zoom, 0).repeat(zoom, 1) for view in views], columns=3)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.png"
        draw(world, path, size_px=flight.height)
        with Image.open(path) as map_:
            both = Image.new("RGB", (map_.width + GAP + flight.width, flight.height), "white")
            both.paste(map_, (0, 0))
    both.paste(flight, (both.width - flight.width, 0))
    return both


def tile_grid(tiles: list[np.ndarray], columns: int) -> Image.Image:
    """Return tiles [h, w, 3] uint8 in rows of `columns` on white, each in a cell as large as the largest tile."""
    high, wide = (max(tile.shape[axis] for tile in tiles) for axis in (0, 1))
    rows = -(-len(tiles) // columns)
    board = np.full((rows * (high + GAP) - GAP, columns * (wide + GAP) - GAP, 3), 255, np.uint8)
    for k, tile in enumerate(tiles):
        y, x = k // columns * (high + GAP), k % columns * (wide + GAP)
        board[y : y + tile.shape[0], x : x + tile.shape[1]] = tile
    return Image.fromarray(board)


if __name__ == "__main__":
    main()
