"""A reach of a real river as data: the file and the part of its line that a command or a run uses."""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from thalweg.core.cache import is_stored
from thalweg.world.errors import WorldFileError
from thalweg.world.real.file_river import from_file, plan_file
from thalweg.world.real.selection import Selection
from thalweg.world.real.sources.extra import installed_versions
from thalweg.world.record import World
from thalweg.world.store.world_cache import load_or_make, named_path


@dataclass(frozen=True)
class Reach(Selection):
    """A reach of the real river in a file; the fields are arguments of `World.from_file`."""

    path: Path
    """The file; a text is made a path."""

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "path", Path(self.path))

    @property
    def name(self) -> str:
        """The file's name, used in tables like a level's name."""
        return self.path.name

    def build(self, seed: int = 0) -> World:
        """Return the world around the reach, with plants and hills from the seed; raises as `World.from_file`.

        It is stored in the cache folder, and loaded from there if it was built before from the same file with the same
        options.
        """
        self.check_options()
        return load_or_make(self._cache_path(seed), lambda: from_file(self.path, seed=seed, **self._options()))

    def is_cached(self, seed: int = 0) -> bool:
        """Return whether the world was built before; False if there is no such file."""
        return self.path.is_file() and is_stored(self._cache_path(seed))

    def check(self) -> None:
        """Raise what `build` raises for the file or a field, without building the world."""
        plan_file(self.path, self)

    def notes(self) -> tuple[str, ...]:
        """Return what was joined, turned, measured or left out of the file, as sentences; raises as `check`."""
        return plan_file(self.path, self).notes

    @property
    def has_banks(self) -> bool:
        """Whether some bank is not forest, by `banks` or by what the file says; raises as `check`."""
        return bool(plan_file(self.path, self).banks)

    def as_data(self) -> dict[str, Any]:
        """Return plain data that identifies the reach; the file counts by name and content, not by its folder.

        Raises `WorldFileError` if there is no such file.
        """
        if not self.path.is_file():
            raise WorldFileError(f"{self.path}: there is no such file")
        content = hashlib.sha256(self.path.read_bytes()).hexdigest()[:16]
        return {"file": self.name, "content": content} | self.reach_data()

    def _options(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in Selection.__dataclass_fields__}

    def _cache_path(self, seed: int) -> Path:
        """Return the path of the world in the cache, which depends on the file, the options and the libraries."""
        key = json.dumps([self.as_data(), seed, installed_versions()], sort_keys=True, default=str)
        return named_path(self.path.stem, seed, key)
