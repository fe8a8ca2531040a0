"""Which real river is flown? A file, and the part of its line: what a command or a run has to say to mean the same."""

import hashlib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from thalweg.world.errors import WorldFileError
from thalweg.world.record import World


@dataclass(frozen=True)
class Reach:
    """A reach of the real river in a GeoJSON file; the fields are the arguments of `World.from_geojson`."""

    path: Path
    width_m: float | None = None
    """Width where the file gives none."""
    start_m: float = 0.0
    """Where along the file's line it begins."""
    length_m: float | None = None
    """How long it is; to the line's end for None."""
    smooth_m: float = 0.0
    """Standard deviation of the Gaussian that rounds the line."""

    @property
    def name(self) -> str:
        """What stands for a level's name in tables: the file's, which no level has."""
        return self.path.name

    def build(self, seed: int = 0) -> World:
        """The world around the reach, its plants and hills drawn by the seed; raises as `World.from_geojson`."""
        options = {field.name: getattr(self, field.name) for field in fields(self)[1:]}
        return World.from_geojson(self.path, seed=seed, **options)

    def as_data(self) -> dict[str, Any]:
        """Plain data that tells this reach from every other: the file by its name and its content, not by its folder.

        Raises `WorldFileError` where there is no such file.
        """
        if not self.path.is_file():
            raise WorldFileError(f"{self.path}: there is no such file")
        content = hashlib.sha256(self.path.read_bytes()).hexdigest()[:16]
        data = {"file": self.name, "content": content}
        return data | {field.name: getattr(self, field.name) for field in fields(self)[1:]}
