"""Sections of reports from outside the package: where they stand, and what is said of one that fails."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from thalweg.bench.report.sections import SECTIONS, FigureSection, Section, TableSection
from thalweg.core.plugins.lookup import every
from thalweg.core.plugins.record import Plugin, PluginError, check_record

GROUP = "thalweg.report_sections"
"""Group of the entry points of report sections."""
PREFIX = "plugin-"
"""Beginning of the names of files of such sections, by which an earlier report's are known."""


@dataclass(frozen=True)
class SectionPlugin:
    """A table or a figure from outside the package; its name is that of the section, such as `my_table`.

    Raises `PluginError` for a name that is taken, a version below 1, and a place that is none.
    """

    section: TableSection | FigureSection
    version: int = 0
    """Version of what it shows, 1 or more. The page names it, beside a hash of the source."""
    after: str = ""
    """Name of the section of the package that it follows; if empty, it stands at the end."""
    plugin_group: ClassVar[str] = GROUP

    def __post_init__(self) -> None:
        section: Any = self.section
        if not isinstance(section, TableSection | FigureSection):
            raise PluginError(f"the section is {section!r}; it must be a TableSection or a FigureSection")
        names = _names(SECTIONS)
        check_record(GROUP, section.name, self.version, names, capital=False)
        if self.after and self.after not in names:
            raise PluginError(
                f"the report section {section.name} stands after {self.after!r}; there are {', '.join(names)}"
            )

    @property
    def name(self) -> str:
        return self.section.name


def with_plugins(sections: Sequence[Section]) -> list[Section]:
    """Return the sections of a page with those of plug-ins at their places; a plug-in that is broken is left out, and a
    warning names it."""
    found = list(sections)
    for plugin in every(GROUP):
        names = [getattr(section, "name", "") for section in found]
        after = plugin.record.after
        place = names.index(after) + 1 if after and after in names else len(found)
        found.insert(place, _named(plugin))
    return found


def is_plugin(section: Section) -> bool:
    """Return whether a section is from outside the package."""
    return getattr(section, "name", "").startswith(PREFIX)


def _named(plugin: Plugin) -> Section:
    """Return the section of a plug-in under the name of its files, with a note that says where it is from."""
    section = plugin.record.section
    source = f"By the plug-in {plugin.name}, version {plugin.record.version} (source {plugin.source})."
    return replace(section, name=f"{PREFIX}{plugin.name}", note=f"{section.note} {source}".lstrip())


def _names(sections: Sequence[Section]) -> list[str]:
    return [section.name for section in sections if isinstance(section, TableSection | FigureSection)]
