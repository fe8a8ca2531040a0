"""`thalweg report`: the report of a results folder, from its files alone."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from thalweg.cli.command import Command
from thalweg.cli.options import Plugins, UsageError
from thalweg.core.notices import notice


@dataclass(frozen=True)
class Report(Command):
    """Write the report of a results folder, from its files alone."""

    results: Positional[Path]
    """Folder that `thalweg bench` wrote."""
    out: Path | None = None
    """Folder to write to, new or that of an earlier report; by default `report` within the results."""
    inline_films: bool = False
    """Put the films into the page, which then is one large file, instead of beside it."""
    plugin: Plugins = ()

    def run(self) -> int:
        from thalweg.bench.report.report import write_report

        if self.results.is_file():
            raise UsageError(f"{self.results} is a file; name the folder that `thalweg bench` wrote")
        report = write_report(self.results, self.out, inline_films=self.inline_films)
        print(f"Report: {report.page}\nTable:  {report.table}")
        for line in report.problems:
            notice(f"Note:   {line}")
        return 0
