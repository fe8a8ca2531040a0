"""Names of the files of a suite's results: none is longer than file systems allow."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from thalweg.bench.suite.arms import Run

MOST_CHARACTERS = 200
"""Length of the name of a run, which is that of its folder and of files."""
FILM = "-failure-error"
"""What the longest name of a file of a policy's films has behind the policy's."""
MOST_BYTES = 255
"""Size of the name of a file in UTF-8, on nearly all file systems."""
TEMPORARY = f"..{16 * '0'}.part.csv"
"""What the name of a file with an ending of three letters grows by while it is written, see `core.atomic_io`."""


def refuse_long_names(runs: "Iterable[tuple[Run, Iterable[str]]]", conditions: Iterable[str]) -> None:
    """Raise `ValueError` for a run, a river or a condition whose name is too long for a file.

    Args:
        runs: Each run, and the names of the levels and real rivers on which it is flown.
        conditions: Names of the conditions, which are those of folders.
    """
    for condition in conditions:
        if _bytes_of(condition) > MOST_BYTES:
            raise ValueError(f"the name of the condition {_shown(condition)} is too long: it is that of a folder")
    for run, levels in runs:
        if len(run.name) > MOST_CHARACTERS:
            raise ValueError(
                f"the run {_shown(run.name)} has a name of {len(run.name)} characters, {MOST_CHARACTERS} are allowed:"
                " give it a shorter name"
            )
        for name in (f"{run.algorithm}{FILM}", *(f"{run.name}-{level}" for level in levels)):
            if (length := _bytes_of(name + TEMPORARY)) > MOST_BYTES:
                raise ValueError(
                    f"the results {_shown(name)} need a file with a name of {length} bytes, {MOST_BYTES} are allowed:"
                    " give the run, or the banks of the level, a shorter name"
                )


def _bytes_of(name: str) -> int:
    return len(name.encode())


def _shown(name: str) -> str:
    """Return a name as text for a message, of a long one the beginning."""
    return repr(name if len(name) <= 60 else f"{name[:60]}...")
