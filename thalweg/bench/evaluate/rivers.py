"""Rivers that suites name: levels, also with other banks, and reaches of the files of real rivers."""

import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import thalweg.world
from thalweg.core.config import refuse_unknown
from thalweg.core.suggestion import did_you_mean
from thalweg.world import LEVELS, Reach, level_named
from thalweg.world.levels import ALL_LEVELS
from thalweg.world.real.selection import Selection

NAME = re.compile(r"\w+([-.]\w+)*")
"""Names that arms, conditions and rivers of files may have, since files and folders are named after them."""
_FILES = Path(thalweg.world.__file__).parent / "real" / "rivers"
RIVERS = {
    "Cam": Reach(_FILES / "cam.geojson", start_m=700.0, length_m=300.0),
    "Wear": Reach(_FILES / "wear.geojson", start_m=450.0, length_m=300.0),
    "Cherwell": Reach(_FILES / "cherwell.geojson", start_m=450.0, length_m=300.0),
}
"""Real rivers of the package, by the name that stands in place of a level in results."""
Files = Mapping[str, Mapping[str, Any]]
"""Files of other real rivers by their names in results: `file`, its path, and options such as `start_m`, which are the
fields of `thalweg.world.real.selection.Selection`."""


def reaches_of(files: Files) -> dict[str, Reach]:
    """Return the real rivers of files by name; raises `WorldError` for an option of another kind."""
    found = {}
    for name, given in files.items():
        options = dict(given)
        found[name] = Reach(Path(options.pop("file")), **options)
    return found


def check_files(files: Files, where: str = "") -> None:
    """Raise `ValueError` for a file that is not there, an option that is wrong, or a name that is taken, whose message
    begins with `where`."""
    for name, options in files.items():
        if not NAME.fullmatch(name):
            raise ValueError(f"a river is called {name!r}; letters, digits, - and . will do")
        if name in RIVERS or name in ALL_LEVELS:
            raise ValueError(f"{where}the name {name!r} is that of another river")
        known = ("file", *Selection.__dataclass_fields__)
        if unknown := [key for key in options if key not in known]:
            meant = did_you_mean(unknown[0], known)
            raise ValueError(f"river {name}: unknown option {unknown[0]!r}{meant}; known: {', '.join(known)}")
        if not isinstance(options.get("file"), str):
            raise ValueError(f"river {name}: file must be the path of a file, not {options.get('file')!r}")
        reach = reaches_of({name: options})[name]
        reach.check_options()
        if not reach.path.is_file():
            raise ValueError(f"river {name}: {reach.path}: there is no such file")


def refuse_unknown_levels(names: Iterable[str], reaches: Iterable[str] = ()) -> None:
    """Raise `ValueError` for a name that is that of no level, on banks of forest or others, and of none of the real
    rivers `reaches`, and for a level with banks by another name than the usual one."""
    known = (*LEVELS, *reaches)
    unknown = [name for name in names if name not in known and not _has_banks(name)]
    refuse_unknown("level", unknown, known, ValueError)
    for name in names:
        if _has_banks(name) and (usual := level_named(name).name) != name:
            raise ValueError(f"level {name!r} is called {usual!r}")


def _has_banks(name: str) -> bool:
    """Return whether a text is the name of a level and kinds of banks, which may be unknown."""
    base, plus, _ = name.partition("+")
    return bool(plus) and base in LEVELS


def is_on_banks(ground: str | Reach) -> bool:
    """Return whether a level or a real river has banks other than forest; raises `WorldFileError` for a file from which
    no river can be made."""
    if isinstance(ground, Reach):
        return _reach_has_banks(ground, ground.as_data()["content"])
    return _has_banks(ground)


def recorded_reach(reach: Reach) -> dict[str, Any]:
    """Return a real river as the record of a suite has it: identified by its content, and with whether it has banks
    other than forest if it has, which no report can read in a file that is elsewhere."""
    return reach.as_data() | ({"has_banks": True} if is_on_banks(reach) else {})


@cache
def _reach_has_banks(reach: Reach, content: str) -> bool:
    """Return whether a reach of a file with a content has banks other than forest."""
    return reach.has_banks
