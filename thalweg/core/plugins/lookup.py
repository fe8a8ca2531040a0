"""Look-up of plug-ins by group and name: those of the files that were given, then those of entry points.

An entry point is imported when its name is asked for, or when all plug-ins of its group are; the files are loaded at
once. They are listed in an environment variable, so that processes which this one starts use the same plug-ins.
"""

import functools
import os
import sys
import warnings
from collections.abc import Iterable, Sequence
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from thalweg.core.plugins.loading import plugin_of, plugins_in
from thalweg.core.plugins.record import NOUNS, Plugin, PluginError, PluginWarning
from thalweg.core.plugins.source import source_files

VARIABLE = "THALWEG_PLUGINS"
"""Environment variable that lists files of plug-ins, separated as in PATH."""


def add_files(files: Iterable[str | Path]) -> None:
    """Use the plug-ins in some files, here and in processes that are started from now on.

    Raises `PluginError` for a file that cannot be used, and for two plug-ins of one kind with the same name; then
    nothing is added.
    """
    paths = [Path(file).resolve() for file in files]
    if (bad := next((path for path in paths if os.pathsep in str(path)), None)) is not None:
        raise PluginError(f"{bad}: a file of plug-ins must have a path without {os.pathsep!r}, which separates paths")
    before = given_files()
    every = list(dict.fromkeys([*before, *paths]))
    if every != before:
        _check_clashes(_plugins_of(every))
        os.environ[VARIABLE] = os.pathsep.join(map(str, every))


def given_files() -> list[Path]:
    """Return the files of plug-ins that are used."""
    return [Path(name).resolve() for name in os.environ.get(VARIABLE, "").split(os.pathsep) if name]


def file_contents() -> list[tuple[str, dict[str, bytes]]]:
    """Return name and sources of each file that is used, for another machine: the file itself and the modules beside it
    that it imports, by their relative paths."""
    return [
        (file.name, {name: path.read_bytes() for name, path in source_files(file, file.parent).items()})
        for file in given_files()
    ]


def find(group: str, name: str, taken: Iterable[str] = ()) -> Plugin | None:
    """Return the plug-in of a group with a name, ignoring case; None without any.

    Raises `PluginError` if it cannot be loaded, if there are two, or if its name is among those that are `taken` by the
    package.
    """
    lower = name.lower()
    found = [each for each in from_files(group) if each.name.lower() == lower]
    points = [point for point in _points(group) if point.name.lower() == lower]
    builtin = next((each for each in taken if each.lower() == lower), None)
    if builtin is not None:
        if points:
            raise PluginError(
                f"the {NOUNS[group]} {builtin} comes with the package, and is also an entry point of"
                f" {_owners(points)}; uninstall that, or give it another name"
            )
        return None
    for point in points:
        plugin = plugin_of(point)
        if not any(plugin.file.resolve() == each.file for each in found):  # installed, and given as a file too
            found.append(plugin)
    _check_clashes(found)
    return found[0] if found else None


def names(group: str) -> list[str]:
    """Return the names of all plug-ins of a group; no entry point is imported."""
    found = [*(each.name for each in from_files(group)), *(point.name for point in _points(group))]
    return list(dict.fromkeys(found))


def every(group: str) -> list[Plugin]:
    """Return all plug-ins of a group; an entry point that cannot be used is left out, and a warning names it."""
    found = []
    for name in names(group):
        try:
            plugin = find(group, name)
        except PluginError as error:
            warnings.warn(f"a plug-in is left out: {error}", PluginWarning, stacklevel=2)
        else:
            found += [] if plugin is None else [plugin]
    return found


def from_files(group: str) -> list[Plugin]:
    """Return the plug-ins of a group in the files that are used."""
    found = [each for each in _plugins_of(given_files()) if each.group == group]
    _check_clashes(found)
    return found


def _plugins_of(files: Sequence[Path]) -> list[Plugin]:
    """Return the plug-ins in files, each loaded once unless it has changed."""
    return [plugin for file in files for plugin in _loaded(file, *_stamp(file))]


@functools.cache
def _loaded(file: Path, changed_ns: int, size: int) -> tuple[Plugin, ...]:
    return tuple(plugins_in(file))


def _stamp(file: Path) -> tuple[int, int]:
    """Return the time of a file's last change and its size; zeros without such a file."""
    try:
        status = file.stat()
    except OSError:
        return 0, 0
    return status.st_mtime_ns, status.st_size


def _points(group: str) -> tuple[EntryPoint, ...]:
    return _points_on(group, tuple(sys.path))


@functools.cache
def _points_on(group: str, path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """Return the entry points of a group; a distribution that is found twice on the path counts once."""
    found = {(point.name, point.value): point for point in reversed(tuple(entry_points(group=group)))}
    return tuple(reversed(found.values()))


def _check_clashes(plugins: Sequence[Plugin]) -> None:
    """Raise `PluginError` for two plug-ins of one group with the same name."""
    seen: dict[tuple[str, str], Plugin] = {}
    for plugin in plugins:
        other = seen.setdefault((plugin.group, plugin.name.lower()), plugin)
        if other is not plugin:
            raise PluginError(
                f"two plug-ins are the {NOUNS[plugin.group]} {plugin.name}: {other.place} ({other.origin}), and"
                f" {plugin.place} ({plugin.origin}); leave one out, or rename it"
            )


def _owners(points: Sequence[EntryPoint]) -> str:
    return ", ".join("an unknown distribution" if each.dist is None else each.dist.name for each in points)
