"""Options that several commands share: numbers as people write them, output files, and the file of a real river."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import UseAppendAction, arg
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec

MOST_DIGITS = 18
"""Most digits of a whole number that is written with a point or an exponent."""


class UsageError(ValueError):
    """Options that do not go together, or a value that cannot be understood."""


@dataclass(frozen=True)
class RiverFile:
    """Options for a real river, used instead of a level."""

    river: Annotated[Path | None, arg(aliases=["--geojson"])] = None
    """File of a real river instead of a level, for bench a further condition: GeoJSON, Overpass JSON, GPX or KML."""
    width_m: float | None = None
    """Width in metres, used where the file has none."""
    start_m: float | None = None
    """Distance in metres along the line at which the reach begins; by default 0."""
    length_m: float | None = None
    """Length of the reach in metres; by default to the end of the line."""
    smooth_m: float | None = None
    """Smooth the line by a Gaussian with this standard deviation in metres."""
    crs: str | None = None
    """Coordinate reference system of a GeoJSON file that names none, or a wrong one, such as EPSG:25832."""
    river_name: str | None = None
    """Name of the river, in a file with several."""
    reverse: bool = False
    """Fly the line from its end to its beginning."""
    flat_water: bool = False
    """Ignore elevations in the file: the water is level."""
    open_water: bool = False
    """Leave out the bridges and islands of the file."""
    banks: tuple[str, ...] = ()
    """Banks of a real river, or (not in bench) a level: forest, meadow, reeds, quay; of a reach: quay_120-180_left."""

    def reach(self, level_option: str, level: str | Sequence[str] | None, *, levels_have_banks: bool = False) -> Any:
        """Return the selected `thalweg.world.Reach`, or None if no file is given.

        Raises `UsageError` for a file beside a level, which the option of that name gave, and for options of a file
        where there is none; --banks is one of them unless the command names its levels by `on_banks`.
        """
        options = self._given()
        if self.river is None:
            if levels_have_banks:
                options.pop("banks", None)
            if options:
                raise UsageError(f"--{min(options).replace('_', '-')} goes with --river")
            return None
        if level:
            named = level if isinstance(level, str) else " ".join(level)
            raise UsageError(f"give {level_option} or --river, not both: {named} and {self.river}")
        from thalweg.world import Reach

        return Reach(self.river, **options)

    def on_banks(self, level: str) -> str:
        """Return the name of a level with the banks that are given, such as Medium+meadow; as it is without any."""
        from thalweg.world.levels import on_banks

        return on_banks(level, self._given()["banks"]) if self.banks else level

    def words(self) -> list[str]:
        """Return the options as command line arguments; empty if no file is given."""
        if self.river is None:
            return []
        words = ["--river", str(self.river)]
        for name, value in self._given().items():
            words.append(f"--{name.replace('_', '-')}")
            if isinstance(value, str):
                words.append(value)
            elif not isinstance(value, bool):
                words.append(repr(float(value)) if value % 1 else f"{value:.0f}")
        return words

    def _given(self) -> dict[str, Any]:
        """Return the options that are given besides the file itself."""
        values = {field.name: getattr(self, field.name) for field in fields(self)[1:]}
        values["banks"] = "+".join(self.banks) or None
        return {name: value for name, value in values.items() if value is not None and value is not False}


River = Annotated[RiverFile, arg(name="")]
"""Its options stand among those of the command."""
NO_FILE = RiverFile()
DEFAULT_LEVEL = {"uav": "Medium", "asv": "Medium-Deep"}
"""Level of each vehicle, where none is named."""


Plugins = Annotated[
    tuple[Path, ...],
    UseAppendAction,
    arg(
        metavar="FILE",
        help="Python file with algorithms, encoders, tasks or report sections of your own; may be given several times.",
    ),
]
"""Files of plug-ins, which `main` loads for every command with such a field `plugin`; the option may be given several
times, and has its help here."""


Policies = Annotated[tuple[str, ...], UseAppendAction]
"""Functions and policies that fly; the option may be given several times."""


def load_world(river: RiverFile, level: str | None, seed: int | None, vehicle: str = "uav") -> Any:
    """Return the world of the file, or that of the level and seed; of the usual level of a vehicle without one."""
    from thalweg.world import level_named, load_or_build

    if (reach := river.reach("--level", level, levels_have_banks=True)) is not None:
        return reach.build(seed or 0)
    chosen = level_named(river.on_banks(level or DEFAULT_LEVEL[vehicle]))
    return load_or_build(chosen, chosen.default_seed if seed is None else seed)


def check_file(option: str, path: Path, *endings: str) -> None:
    """Raise `UsageError` for a path to write to that is a folder, does not end as its kind of file does, or lies where
    nothing may be written; folders on the way to it that are not there yet are made with it."""
    if path.is_dir():
        raise UsageError(f"{option} {path} is a folder; name a file in it, such as {path / ('new' + endings[0])}")
    if path.suffix.lower() not in endings:
        raise UsageError(f"{option} must end in {' or '.join(endings)}, not {path.name!r}")
    home = next(folder for folder in path.absolute().parents if folder.exists())
    if not home.is_dir():
        raise UsageError(f"{option} {path} cannot be written: {home} is not a folder")
    if not os.access(home, os.W_OK | os.X_OK):
        raise UsageError(f"{option} {path} cannot be written: no permission to write into {home}")


def checked_task(name: str) -> Any:
    """Return the name of a task; raises `UsageError`, which lists the tasks, for another."""
    from thalweg.core.suggestion import did_you_mean
    from thalweg.env.tasks import task_names

    if name not in (known := task_names()):
        raise UsageError(f"unknown task {name!r}{did_you_mean(name, known)}; known: {', '.join(known)}")
    return name


def whole_number(text: str) -> int:
    """Return a whole number from text such as 200000, 200_000 or 2e5; raises `UsageError` for anything else."""
    try:
        return int(text)
    except ValueError:
        pass
    try:
        value = Decimal(text)
    except InvalidOperation:
        value = Decimal("NaN")
    if value.is_finite() and value.adjusted() < MOST_DIGITS and value == value.to_integral_value():
        return int(value)
    raise UsageError(f"{text!r} is not a whole number; write one such as 0, 200000 or 2e5")


def number(text: str) -> float:
    """Return a number from text; raises `UsageError` for anything else."""
    try:
        return float(text)
    except ValueError:
        raise UsageError(f"{text!r} is not a number; write one such as 12, 0.5 or 1e-4") from None


def settings_from(given: Sequence[str], option: str = "--set") -> dict[str, Any]:
    """Return the settings in `key=value` pairs of an option, whose values are YAML: numbers, words, true and false,
    lists."""
    import yaml

    from thalweg.core.yaml12 import load

    settings: dict[str, Any] = {}
    for pair in given:
        key, equals, value = pair.partition("=")
        if not equals or not key:
            raise UsageError(f"{option} takes key=value, not {pair!r}")
        if key in settings:
            raise UsageError(f"{option} gives {key} twice: leave one of them out")
        try:
            settings[key] = load(value)
        except yaml.YAMLError as error:
            raise UsageError(f"{option} {pair!r} cannot be understood: {' '.join(str(error).split())}") from error
    return settings


def _spec(read: Callable[[str], Any], metavar: str, count: Any) -> PrimitiveConstructorSpec:
    """Return tyro's description of an option that holds one or several numbers; a default of None stays None."""

    def instance(texts: list[str]) -> Any:
        values = tuple(read(text) for text in texts)
        return values[0] if count == 1 else values

    def written(value: Any) -> list[str]:
        return [str(one) for one in value] if isinstance(value, tuple) else [str(value)]

    return PrimitiveConstructorSpec(count, metavar, instance, lambda _: True, written)


POSE = tuple[float, float, float, float]
NUMBERS = (
    ((int, int | None), _spec(whole_number, "INT", 1)),
    ((float, float | None), _spec(number, "FLOAT", 1)),
    ((POSE, POSE | None), _spec(number, "X Y Z YAW", 4)),
)
"""Types of fields, and how each is read. Tyro's own readers would report a wrong number in Python's words."""

REGISTRY = ConstructorRegistry()


@REGISTRY.primitive_rule
def read_number(info: Any) -> PrimitiveConstructorSpec | None:
    """Return tyro's description of a field that holds one or several numbers; None for other fields."""
    return next((spec for types, spec in NUMBERS if info.type in types), None)
