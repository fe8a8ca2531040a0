"""Loading of plug-ins: the records at the top level of a file, and the record that an entry point names."""

import hashlib
import importlib
import importlib.util
import os
import sys
import traceback
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any

from thalweg.core.plugins.record import CLASSES, Plugin, PluginError
from thalweg.core.plugins.source import assignments, assignments_and_functions, source_files, source_hash
from thalweg.core.suggestion import did_you_mean

MODULES = "thalweg_plugin_"
"""Beginning of the names of modules that are loaded from files."""


def plugins_in(file: Path) -> list[Plugin]:
    """Return the plug-ins in a file: all records at its top level.

    The folder of the file is appended to `sys.path`, so that the file may import modules beside it. Raises
    `PluginError` for a file that is missing, fails, or holds no record.
    """
    if not file.is_file():
        raise PluginError(f"there is no plug-in {file}: name a file of Python, such as mine.py")
    source = source_hash(source_files(file, file.parent))
    values = vars(_module_of(file))
    found = {id(values[name]): (values[name], line) for name, line in assignments(file).items() if name in values}
    records = [(value, line) for value, line in found.values() if _group_of(value)]
    if not records:
        raise PluginError(
            f"{file} holds no plug-in: at its top level, assign a record such as"
            f" PLUGIN = {CLASSES['thalweg.algorithms'].rpartition('.')[2]}(...); docs/extend.md has an example"
        )
    return [Plugin(value, _group_of(value), file, line, source, f"--plugin {file}") for value, line in records]


def plugin_of(point: EntryPoint) -> Plugin:
    """Return the plug-in of an entry point; raises `PluginError` if it cannot be imported or is something else."""
    origin = f"the entry point {point.name!r} of {_distribution(point)} ({point.value})"
    try:
        module = importlib.import_module(point.module)
        file = Path(module.__file__ or "")
        value: Any = point.load()
    except Exception as error:
        raise PluginError(f"{origin} cannot be loaded: {_in_words(error, None)}") from error
    line = assignments(file).get((point.attr or "").partition(".")[0], 1)
    place = f"{file}, line {line}"
    if _group_of(value) != point.group:
        raise PluginError(
            f"{place}: {origin} is a {type(value).__name__}; in the group {point.group} it must be a"
            f" {CLASSES[point.group]}"
        )
    if value.name != point.name:
        raise PluginError(f"{place}: {origin} is named {value.name!r}; give both the same name")
    source = source_hash(_files_of_module(point.module, file))
    return Plugin(value, point.group, file, line, source, origin)


def object_named(reference: str) -> tuple[Any, str]:
    """Return the object of a reference and the hash of its source.

    A reference is a file or a module, a colon, and a name at its top level: `fly.py:fly` or `package.module:fly`.
    Raises `PluginError` for one that leads nowhere.
    """
    place, _, name = reference.rpartition(":")
    if place.endswith(".py"):
        file = Path(place).resolve()
        if not file.is_file():
            raise PluginError(f"there is no file {file}; {reference!r} must name one, such as fly.py:fly")
        source = source_hash(source_files(file, file.parent))
        module = _module_of(file)
    else:
        if (folder := os.getcwd()) not in sys.path:
            sys.path.append(folder)
        try:
            module = importlib.import_module(place)
        except Exception as error:
            raise PluginError(f"{place} cannot be imported: {_in_words(error, None)}") from error
        file = Path(module.__file__ or place)
        source = source_hash(_files_of_module(place, file)) if file.is_file() else ""
    if not hasattr(module, name):
        known = [each for each in assignments_and_functions(file) if not each.startswith("_")] if source else []
        has = f"; it has {', '.join(known)}" if known else ""
        raise PluginError(f"{file} has no {name!r} at its top level{did_you_mean(name, known)}{has}")
    return getattr(module, name), source


def _files_of_module(name: str, file: Path) -> dict[str, Path]:
    """Return the files of a module's source: itself, and what it imports of its own top-level package."""
    root = file.parents[name.count(".") + (file.name == "__init__.py")]
    return source_files(file, root, name.partition(".")[0])


def _group_of(value: Any) -> str:
    """Return the group of a record; empty for anything else."""
    return getattr(type(value), "plugin_group", "")


def _module_of(file: Path) -> ModuleType:
    """Return the module of a file, executed; raises `PluginError` that names the line in which it fails."""
    if (folder := str(file.parent)) not in sys.path:
        sys.path.append(folder)
    digest = hashlib.sha256(os.fsencode(file)).hexdigest()[:8]
    name = f"{MODULES}{file.stem}_{digest}"
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise PluginError(f"{file} is no file of Python: its name must end in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look up the module of their annotations
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise PluginError(_in_words(error, file)) from error
    return module


def _in_words(error: Exception, file: Path | None) -> str:
    """Return an error of an import with file and line: the last one outside the package and Python's own modules."""
    frames = [(frame.filename, frame.lineno) for frame in traceback.extract_tb(error.__traceback__)]
    if isinstance(error, SyntaxError) and error.filename:
        frames.append((error.filename, error.lineno))
    package, own = str(Path(__file__).parents[2]) + os.sep, os.path.dirname(os.__file__) + os.sep
    outside = [
        (name, line)
        for name, line in frames
        if name == str(file)
        or not (name.startswith((package, "<")) or (name.startswith(own) and "-packages" not in name))
    ]
    place = f"{outside[-1][0]}, line {outside[-1][1]}: " if outside else "" if file is None else f"{file}: "
    ours = type(error).__module__.partition(".")[0] == "thalweg"
    return f"{place}{error}" if ours else f"{place}{type(error).__name__}: {error}"


def _distribution(point: EntryPoint) -> str:
    dist = point.dist
    return "an unknown distribution" if dist is None else f"{dist.name} {dist.version}"
