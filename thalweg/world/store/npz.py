"""The world file format: one `.npz` of plain arrays with a JSON description.

Files are written atomically, and nothing in them can execute code.
"""

import json
import operator
from dataclasses import fields
from pathlib import Path

import numpy as np

from thalweg.core.atomic_io import atomic_path
from thalweg.world.banks import as_data, read_banks
from thalweg.world.errors import WorldError, WorldFileError
from thalweg.world.record import BRIDGE, FORMAT, Grid, Plants, River, World
from thalweg.world.species import KINDS

KIND = "thalweg world"
"""Value of the key `kind` in the description."""
MAPS = {"ground_m": "float32", "water_m": "float32", "sun": "uint8", "sky": "uint8", "canopy_m": "float32"}
"""Arrays [GY, GX] of a world and their types."""
RIVER = {"position_m": 2, "arc_m": 1, "tangent": 2, "width_m": 1, "depth_m": 1, "level_m": 1}
"""Arrays [S] or [S, 2] of a river and their number of axes; all float64."""


SIZES = {"islands": [2, 3], "bridges": [BRIDGE.index(name) for name in ("length", "width", "span", "rise")]}
"""Columns that hold sizes, which are positive."""
ARRAYS = {
    *("about", *MAPS, "albedo", "islands", "bridges"),
    *(f"river.{name}" for name in RIVER),
    *(f"plants.{field.name}" for field in fields(Plants)),
}
"""Names of all arrays of a file; others are not read."""
MOST_BYTES = 4_000_000_000
"""Greatest size of the arrays of a file: a small archive may unpack to any size."""


def save(world: World, path: str | Path) -> None:
    """Write a world to `path` atomically; its folder is created if missing."""
    description = {
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
    if world.banks:  # files of forest alone are the same bytes as before there were others
        description["banks"] = as_data(world.banks)
    arrays = {"about": np.array(json.dumps(description, sort_keys=True))}
    arrays |= {f"river.{name}": getattr(world.river, name) for name in RIVER}
    arrays |= {f"plants.{field.name}": getattr(world.plants, field.name) for field in fields(Plants)}
    arrays |= {name: getattr(world, name) for name in (*MAPS, "albedo", "islands", "bridges")}
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def load(path: str | Path) -> World:
    """Return the world in a file; raises `WorldFileError` that names the path and the fault."""
    path = Path(path)
    if not path.is_file():
        raise WorldFileError(f"{path}: there is no such file")
    try:
        with np.load(path, allow_pickle=False) as stored:
            size = sum(member.file_size for member in stored.zip.infolist())
            too_large = size > MOST_BYTES
            arrays = {name: stored[name] for name in stored.files if name in ARRAYS} if not too_large else {}
    except Exception as error:  # A damaged zip may raise nearly anything: encrypted, unknown compression, too large...
        # NumPy takes a file that is no zip archive for a pickle, and advises to trust it.
        reason = "it is not a zip archive" if "pickle" in str(error) else error
        raise WorldFileError(f"{path}: not a complete .npz file ({reason})") from None
    if too_large:
        raise WorldFileError(f"{path}: {size / 1e9:.1f} GB unpacked; limit {MOST_BYTES / 1e9:.0f} GB")
    description = _read_description(path, arrays)
    _check_arrays(path, arrays)
    river = {name: arrays[f"river.{name}"] for name in RIVER}
    try:
        kinds = ", ".join(description["kinds"])
        world = World(
            name=str(description["name"]),
            seed=operator.index(description["seed"]),
            river=River(closed=_flag(description["closed"]), length_m=float(description["length_m"]), **river),
            islands=arrays["islands"],
            bridges=arrays["bridges"],
            grid=Grid(*(float(value) for value in description["grid"])),
            **{name: arrays[name] for name in MAPS},
            albedo=arrays["albedo"],
            plants=Plants(**{field.name: arrays[f"plants.{field.name}"] for field in fields(Plants)}),
            sun_azimuth=float(description["sun"][0]),
            sun_elevation=float(description["sun"][1]),
            banks=read_banks(description.get("banks", ())),
        )
    except WorldError as reason:
        raise WorldFileError(f"{path}: {reason}") from None
    except (KeyError, TypeError, ValueError, IndexError, OverflowError) as reason:
        raise WorldFileError(f"{path}: its description is incomplete ({reason!r})") from None
    if kinds != (known := ", ".join(kind.name for kind in KINDS)):
        raise WorldFileError(f"{path}: made for the kinds of plants {kinds}; this version draws {known}")
    if wrong := _array_error(arrays) or _description_error(world) or _position_error(world):
        raise WorldFileError(f"{path}: {wrong}")
    return world


def _flag(value: object) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f"closed must be true or false, not {value!r:.40}")
    return value


def _read_description(path: Path, arrays: dict[str, np.ndarray]) -> dict:
    """Return the description of a file after checking its kind and format version."""
    try:
        description = json.loads(str(arrays["about"]))
        kind, version = description["kind"], description["format"]
    except (KeyError, TypeError, ValueError, RecursionError):
        raise WorldFileError(f"{path}: an .npz file, but not of a world") from None
    if kind != KIND:
        raise WorldFileError(f"{path}: an .npz file of kind {kind!r}, not {KIND!r}")
    if version != FORMAT:
        raise WorldFileError(f"{path}: a world of format {version}; this version reads format {FORMAT}")
    return description


def _check_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Check that every array is present, with its type and with shapes that fit together."""
    ground = arrays.get("ground_m")
    grid = (None, None) if ground is None or ground.ndim != 2 else ground.shape
    lines = [arrays.get(name) for name in ("river.arc_m", "plants.kind")]
    samples, count = (None if line is None or line.ndim != 1 else len(line) for line in lines)
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


def _array_error(arrays: dict[str, np.ndarray]) -> str | None:
    """Return what is wrong with the numbers in the arrays, or None: known kinds, positive sizes, finite values."""
    for name, values in arrays.items():
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            return f"{name!r} holds {values[~np.isfinite(values)][0]}, which is not a finite number"
    kind = arrays["plants.kind"]
    if (unknown := kind[(kind < 0) | (kind >= len(KINDS))]).size:
        return f"'plants.kind' holds {unknown[0]}; the kinds are 0 to {len(KINDS) - 1}"
    for name in ("plants.height_m", "plants.width_m", "river.width_m", "river.depth_m"):
        if (arrays[name] <= 0).any():
            return f"{name!r} holds {arrays[name].min()}; limit > 0"
    for name, columns in SIZES.items():
        sizes = arrays[name][:, columns]
        if (sizes <= 0).any():
            return f"{name!r} holds a size of {sizes.min()} m; limit > 0"
    return None


def _description_error(world: World) -> str | None:
    """Return what is wrong with the scalars of the world and the sizes of its arrays, or None."""
    river, grid = world.river, world.grid
    scalars = (river.length_m, grid.origin_x_m, grid.origin_y_m, grid.cell_m, world.sun_azimuth, world.sun_elevation)
    if bad := [value for value in scalars if not np.isfinite(value)]:
        return f"its description holds {bad[0]}, which is not a finite number"
    if world.name != world.name.encode("utf-8", "replace").decode():  # JSON can hold halves of characters
        return f"the name {world.name!r}, which is not Unicode"
    if world.seed < 0:
        return f"the seed {world.seed}; limit >= 0"
    if grid.cell_m <= 0:
        return f"a cell size of {grid.cell_m} m; limit > 0"
    if min(world.ground_m.shape) < 2:
        return f"a map of {world.ground_m.shape[0]} x {world.ground_m.shape[1]} nodes; at least 2 x 2"
    if len(river.arc_m) < 2:
        return f"a course of {len(river.arc_m)} samples; at least 2"
    if river.length_m < river.arc_m[-1] - 1e-6:
        return f"a course of {river.length_m} m with a sample at {river.arc_m[-1]} m"
    if river.arc_m[0] != 0 or (np.diff(river.arc_m) <= 0).any():
        return f"a course of {river.length_m} m whose arc length does not grow from 0"
    return None


def _position_error(world: World) -> str | None:
    """Return which sample of the course or plant is off the map by more than a cell, or None."""
    grid = world.grid
    low = np.array([grid.origin_x_m, grid.origin_y_m])
    high = low + grid.cell_m * np.array(world.ground_m.shape[::-1])
    for subject, points in (("the course runs", world.river.position_m), ("a plant stands", world.plants.position_m)):
        off = ((points[:, :2] < low - grid.cell_m) | (points[:, :2] > high)).any(axis=1)
        if off.any():
            x, y = points[off][0, :2]
            return f"{subject} at ({x:g}, {y:g}) m, off the map"
    return None
