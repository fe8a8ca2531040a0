"""How does a world lie on disk? One `.npz` of plain arrays, with a line of JSON that says what it is.

Written whole or not at all; nothing in it can execute code.
"""

import json
from dataclasses import fields
from pathlib import Path

import numpy as np

from thalweg.core.atomic_io import atomic_path
from thalweg.world.errors import WorldFileError
from thalweg.world.record import FORMAT, Grid, Plants, River, World
from thalweg.world.species import KINDS

KIND = "thalweg world"
"""What the JSON line calls itself."""
MAPS = {"ground_m": "float32", "water_m": "float32", "sun": "uint8", "sky": "uint8", "canopy_m": "float32"}
"""Arrays [GY, GX] of a world and their types."""
RIVER = {"position_m": 2, "arc_m": 1, "tangent": 2, "width_m": 1, "depth_m": 1, "level_m": 1}
"""Arrays [S] or [S, 2] of a river and their number of axes; all float64."""


def save(world: World, path: str | Path) -> None:
    """Write a world to `path`; its folder is made if missing. An interrupted write leaves what was there before."""
    about = {
        "kind": KIND,
        "format": FORMAT,
        "name": world.name,
        "seed": world.seed,
        "closed": world.river.closed,
        "length_m": world.river.length_m,
        "grid": [world.grid.origin_x_m, world.grid.origin_y_m, world.grid.cell_m],
        "sun": [world.sun_azimuth, world.sun_elevation],
        "kinds": [kind.name for kind in KINDS],
    }
    arrays = {"about": np.array(json.dumps(about, sort_keys=True))}
    arrays |= {f"river.{name}": getattr(world.river, name) for name in RIVER}
    arrays |= {f"plants.{field.name}": getattr(world.plants, field.name) for field in fields(Plants)}
    arrays |= {name: getattr(world, name) for name in (*MAPS, "albedo", "islands", "bridges")}
    with atomic_path(path) as draft, draft.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def load(path: str | Path) -> World:
    """The world in a file; raises `WorldFileError` that names the path and what is wrong with it."""
    path = Path(path)
    if not path.is_file():
        raise WorldFileError(f"{path}: there is no such file")
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except (
        Exception
    ) as reason:  # A damaged zip raises what its bytes happen to say: encrypted, unknown packing, huge...
        # NumPy takes what is no zip for a pickle, and advises to trust it.
        said = "it is no zip archive" if "pickle" in str(reason) else reason
        raise WorldFileError(f"{path}: not a whole .npz file ({said})") from None
    about = _about(path, arrays)
    _check_arrays(path, arrays)
    river = {name: arrays[f"river.{name}"] for name in RIVER}
    try:
        kinds = ", ".join(about["kinds"])
        world = World(
            name=str(about["name"]),
            seed=int(about["seed"]),
            river=River(closed=bool(about["closed"]), length_m=float(about["length_m"]), **river),
            islands=arrays["islands"],
            bridges=arrays["bridges"],
            grid=Grid(*(float(value) for value in about["grid"])),
            **{name: arrays[name] for name in MAPS},
            albedo=arrays["albedo"],
            plants=Plants(**{field.name: arrays[f"plants.{field.name}"] for field in fields(Plants)}),
            sun_azimuth=float(about["sun"][0]),
            sun_elevation=float(about["sun"][1]),
        )
    except (KeyError, TypeError, ValueError, IndexError) as reason:
        raise WorldFileError(f"{path}: its description is incomplete ({reason!r})") from None
    if kinds != (known := ", ".join(kind.name for kind in KINDS)):
        raise WorldFileError(f"{path}: made for the kinds of plants {kinds}; this version draws {known}")
    if wrong := _wrong_number(arrays) or _wrong_about(world) or _wrong_place(world):
        raise WorldFileError(f"{path}: {wrong}")
    return world


def _about(path: Path, arrays: dict[str, np.ndarray]) -> dict:
    """The description of a file, checked for kind and version."""
    try:
        about = json.loads(str(arrays["about"]))
        kind, version = about["kind"], about["format"]
    except (KeyError, TypeError, ValueError):
        raise WorldFileError(f"{path}: an .npz file, but not of a world") from None
    if kind != KIND:
        raise WorldFileError(f"{path}: an .npz file of kind {kind!r}, not {KIND!r}")
    if version != FORMAT:
        raise WorldFileError(f"{path}: a world of format {version}; this version reads format {FORMAT}")
    return about


def _check_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Every array there, of its type, and of shapes that fit together."""
    grid = arrays["ground_m"].shape if "ground_m" in arrays else (-1, -1)
    samples = len(arrays["river.arc_m"]) if "river.arc_m" in arrays else -1
    count = len(arrays["plants.kind"]) if "plants.kind" in arrays else -1
    expected: dict[str, tuple[tuple, str]] = {name: (grid, kind) for name, kind in MAPS.items()}
    expected["albedo"] = ((*grid, 3), "uint8")
    expected["islands"] = ((None, 5), "float64")
    expected["bridges"] = ((None, 11), "float64")
    expected |= {f"river.{name}": ((samples, 2)[:axes], "float64") for name, axes in RIVER.items()}
    for name, (shape, kind) in {
        "position_m": ((count, 3), "float32"),
        "height_m": ((count,), "float32"),
        "width_m": ((count,), "float32"),
        "kind": ((count,), "int16"),
        "turn": ((count,), "float32"),
        "tint": ((count, 3), "float32"),
        "light": ((count, 2), "float32"),
    }.items():
        expected[f"plants.{name}"] = (shape, kind)
    for name, (shape, kind) in expected.items():
        if name not in arrays:
            raise WorldFileError(f"{path}: the array {name!r} is missing")
        found = arrays[name]
        fits = found.ndim == len(shape) and all(a in (None, b) for a, b in zip(shape, found.shape, strict=True))
        if not fits or found.dtype != kind:
            raise WorldFileError(f"{path}: {name!r} is {found.dtype} {found.shape}; expected {kind} {shape}")


def _wrong_number(arrays: dict[str, np.ndarray]) -> str | None:
    """What is wrong with single numbers of the arrays: kinds that are drawn, sizes above zero, all finite."""
    for name, values in arrays.items():
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            return f"{name!r} holds {values[~np.isfinite(values)][0]}, which is no finite number"
    kind = arrays["plants.kind"]
    if (beyond := kind[(kind < 0) | (kind >= len(KINDS))]).size:
        return f"'plants.kind' holds {beyond[0]}; the kinds are 0 to {len(KINDS) - 1}"
    for name in ("plants.height_m", "plants.width_m", "river.width_m", "river.depth_m"):
        if (arrays[name] <= 0).any():
            return f"{name!r} holds {arrays[name].min()}; limit > 0"
    return None


def _wrong_about(world: World) -> str | None:
    """What is wrong with the numbers that are no arrays, and with the sizes of those that are."""
    river, grid = world.river, world.grid
    told = (river.length_m, grid.origin_x_m, grid.origin_y_m, grid.cell_m, world.sun_azimuth, world.sun_elevation)
    if bad := [value for value in told if not np.isfinite(value)]:
        return f"its description holds {bad[0]}, which is no finite number"
    if world.seed < 0:
        return f"the seed {world.seed}; limit >= 0"
    if grid.cell_m <= 0:
        return f"cells of {grid.cell_m} m; limit > 0"
    if min(world.ground_m.shape) < 2:
        return f"a map of {world.ground_m.shape[0]} x {world.ground_m.shape[1]} nodes; at least 2 x 2"
    if len(river.arc_m) < 2:
        return f"a course of {len(river.arc_m)} samples; at least 2"
    if river.length_m <= 0 or river.arc_m[0] != 0 or (np.diff(river.arc_m) <= 0).any():
        return f"a course of {river.length_m} m whose arc length does not grow from 0"
    return None


def _wrong_place(world: World) -> str | None:
    """Whether course and plants stand on the map, give or take a cell, as whoever reads the map at them trusts."""
    grid = world.grid
    low = np.array([grid.origin_x_m, grid.origin_y_m])
    high = low + grid.cell_m * np.array(world.ground_m.shape[::-1])
    for what, places in (("the course runs", world.river.position_m), ("a plant stands", world.plants.position_m)):
        off = ((places[:, :2] < low - grid.cell_m) | (places[:, :2] > high)).any(axis=1)
        if off.any():
            x, y = places[off][0, :2]
            return f"{what} at ({x:g}, {y:g}) m, off the map"
    return None
