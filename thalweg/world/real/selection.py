"""The options with which a river is taken from a file."""

from dataclasses import dataclass
from typing import Any

from thalweg.world.banks import parse_banks
from thalweg.world.errors import WorldError
from thalweg.world.real.reach_line import check_options


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Which river of a file is taken, and which part of it."""

    width_m: float | None = None
    """Width in metres where the file gives none."""
    start_m: float = 0.0
    """Distance along the line at which the reach begins."""
    length_m: float | None = None
    """Length of the reach; None for the rest of the line."""
    smooth_m: float = 0.0
    """Standard deviation of the Gaussian that rounds the line."""
    crs: str | None = None
    """Coordinate reference system of a GeoJSON file that names none, or a wrong one, such as EPSG:25832."""
    river_name: str | None = None
    """Name of the river, in a file with several."""
    reverse: bool = False
    """Whether the line is run from its end to its beginning."""
    flat_water: bool = False
    """Whether elevations in the file are ignored, so that the water is level."""
    open_water: bool = False
    """Whether bridges and islands in the file are left out."""
    banks: str = ""
    """Kinds of the banks as `thalweg.world.banks.read_banks` takes them, such as meadow, over those that the file
    names. Texts, records and sequences of them are stored as one text."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "banks", "+".join(reach.text for reach in parse_banks(self.banks or None)))

    def check_options(self) -> None:
        """Raise `WorldError` for an option that is out of its range or not of its kind."""
        check_options(self.width_m, self.start_m, self.length_m, self.smooth_m)
        for name in ("crs", "river_name"):
            value = getattr(self, name)
            if value is not None and (not isinstance(value, str) or not value.strip()):
                raise WorldError(f"{name} is {value!r}; expected text")
        for name in ("reverse", "flat_water", "open_water"):
            if not isinstance(getattr(self, name), bool):
                raise WorldError(f"{name} is {getattr(self, name)!r}; expected True or False")

    def reach_data(self) -> dict[str, Any]:
        """Return the options of the reach, and those others that are not as by default: older runs had none of them."""
        values = {name: getattr(self, name) for name in Selection.__dataclass_fields__}
        plain = ("width_m", "start_m", "length_m", "smooth_m")
        return {
            name: value
            for name, value in values.items()
            if name in plain or value != Selection.__dataclass_fields__[name].default
        }
