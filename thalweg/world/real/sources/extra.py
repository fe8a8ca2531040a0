"""Import of the libraries of the extra `[geo]`, only when a file needs one of them."""

import importlib
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from thalweg.core.extras import how_to_install
from thalweg.world.errors import WorldError

LIBRARIES = ("shapely", "pyproj", "gpxpy", "defusedxml")
"""Libraries of the extra `[geo]`. A line in longitude and latitude needs none of them."""


def need(module: str, purpose: str) -> Any:
    """Return a module of one of `LIBRARIES`; raises `WorldError` that names the extra if it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError:
        library = module.partition(".")[0]
        raise WorldError(f"{purpose} needs {library}, which is not installed: {how_to_install('geo')}") from None


def installed_versions() -> tuple[str, ...]:
    """Return the versions of `LIBRARIES`, empty for one that is not installed: another one may round differently."""
    found = []
    for library in LIBRARIES:
        try:
            found.append(version(library))
        except PackageNotFoundError:
            found.append("")
    return tuple(found)
