"""Records of plug-ins: the groups they belong to, what every one of them states, and their errors and warnings."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

NOUNS = {
    "thalweg.algorithms": "algorithm",
    "thalweg.report_sections": "report section",
    "thalweg.encoders": "encoder",
    "thalweg.tasks": "task",
}
"""What the plug-ins of each group of entry points are."""
CLASSES = {
    "thalweg.algorithms": "thalweg.algos.AlgorithmPlugin",
    "thalweg.report_sections": "thalweg.bench.report.plugins.SectionPlugin",
    "thalweg.encoders": "thalweg.encoder.EncoderPlugin",
    "thalweg.tasks": "thalweg.env.TaskPlugin",
}
"""Class of the records of each group. A class names its group as `plugin_group`, by which its records are found."""
NAMES = {True: re.compile(r"[A-Z]\w*"), False: re.compile(r"[a-z]\w*")}
"""Names that begin with a capital, and those that do not."""


RESERVED = (
    *("world", "rules", "tasks", "evaluation", "steady", "imitation", "render", "encoder", "geometry", "packaged"),
    *("privileged", "training", "props", "forces", "banks", "sources", "default", "deadlines", "shield"),
)
"""Names that belong to versions of other things in the records of results."""


class PluginError(ValueError):
    """Error for a plug-in that cannot be loaded or used; the message names file, line, and what would be right."""


class PluginWarning(UserWarning):
    """Warning about a plug-in that is left out, or whose source has changed under the same version."""


@dataclass(frozen=True)
class Plugin:
    """A plug-in that was loaded."""

    record: Any
    """What the plug-in provides; it has a `name` and a `version`."""
    group: str
    """Group of entry points that it belongs to."""
    file: Path
    """The file that defines it."""
    line: int
    """The line in the file."""
    source: str
    """Hash of its source: 16 hexadecimal digits."""
    origin: str
    """How it came here, for messages: `--plugin mine.py`, or the entry point and its distribution."""

    @property
    def name(self) -> str:
        return self.record.name

    @property
    def place(self) -> str:
        """File and line, for messages."""
        return f"{self.file}, line {self.line}"

    def as_data(self) -> dict[str, Any]:
        """Return what results bear of it, as plain data."""
        return {"version": self.record.version, "source": self.source}


def changed_source(name: str, where: str, before: str, now: str) -> str:
    """Return the warning that the source of a plug-in has changed, and its version has not."""
    return (
        f"the source of {name} has changed since {where} was made (its hash was {before or 'not recorded'}, and is"
        f" {now or 'none'} now), but its version is still the same; raise the version if results change, so that"
        " both are never mixed"
    )


def check_record(group: str, name: Any, version: Any, taken: Iterable[str], *, capital: bool = True) -> None:
    """Raise `PluginError` for a name that is not one or is `taken` by the package, and for a version that is none.

    Names of algorithms and tasks begin with a `capital` letter, others with a small one: so no name is also that of a
    baseline or of a version.
    """
    noun = NOUNS[group]
    if not isinstance(name, str) or not NAMES[capital].fullmatch(name):
        letter, such = ("capital", "MyPPO") if capital else ("small", "my_own")
        raise PluginError(
            f"the name of the {noun} is {name!r}; it must begin with a {letter} letter, and hold letters, digits and _,"
            f" such as {such!r}"
        )
    if clash := [each for each in taken if each.lower() == name.lower()]:
        raise PluginError(f"the {noun} {clash[0]!r} comes with the package; give yours another name, such as My{name}")
    if type(version) is not int or version < 1:
        raise PluginError(
            f"the {noun} {name} has the version {version!r}; state version=1, and raise it when results change"
        )
