"""`thalweg leaderboard`: the trained policies of results folders, ranked."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from thalweg.cli.command import Command
from thalweg.cli.options import Plugins, check_file
from thalweg.core.atomic_io import write_atomic


@dataclass(frozen=True)
class Leaderboard(Command):
    """Rank the policies of results folders, task by task: first by meeting the cost limit, then by return."""

    results: Positional[tuple[Path, ...]]
    """Folders that `thalweg bench` wrote."""
    out: Path | None = None
    """Write the page to this .md file instead of printing it, replacing it."""
    plugin: Plugins = ()

    def run(self) -> int:
        from thalweg.bench.leaderboard import leaderboard

        if self.out is not None:
            check_file("--out", self.out, ".md")
        page = leaderboard(self.results, self.plugin)
        if self.out is None:
            print(page)
        else:
            write_atomic(self.out, page)
            print(f"{self.out}: the leaderboard")
        return 0
