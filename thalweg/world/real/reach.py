"""A reach of a real river as data: the file and the part of its line that a command or a run uses."""

import hashlib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from thalweg.world.errors import WorldFileError
from thalweg.world.real.geojson_river import check_geojson
from thalweg.world.record import World


@dataclass(frozen=True)
class Reach:
    """A reach of the real river in a GeoJSON file; the fields are arguments of `World.from_geojson`."""

    path: Path
    width_m: float | None = None
    """Width in metres where the file gives none."""
    start_m: float = 0.0
    """Distance along the file's line at which the reach begins."""
    length_m: float | None = None
    """Length; None for the rest of the line."""
    smooth_m: float = 0.0
    """Standard deviation of the Gaussian that rounds the line."""

    @property
    def name(self) -> str:
        """The file's name, used in tables like a level's name."""
        return self.path.name

    def build(self, seed: int = 0) -> World:
        """Return the world around the reach, with plants and hills from the seed; raises as `World.from_geojson`."""
        return World.from_geojson(self.path, seed=seed, **self._options())

    def check(self) -> None:
        """Raise what `build` raises for the file or a field, without building the world."""
        check_geojson(self.path, **self._options())

    def as_data(self) -> dict[str, Any]:
        """Return plain data that identifies the reach; the file counts by name and content, not by its folder.

        Raises `WorldFileError` if there is no such file.
        """
        if not self.path.is_file():
            raise WorldFileError(f"{self.path}: there is no such file")
        content = hashlib.sha256(self.path.read_bytes()).hexdigest()[:16]
        data = {"file": self.name, "content": content}
        return data | self._options()

    def _options(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)[1:]}
