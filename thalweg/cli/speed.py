"""`thalweg speed`: the speed of each part on this machine."""

from dataclasses import dataclass
from pathlib import Path

from thalweg.cli.command import Command
from thalweg.cli.options import check_file


@dataclass(frozen=True)
class Speed(Command):
    """Measure the speed of each part on this machine."""

    json: bool = False
    """Print JSON instead of a table."""
    quick: bool = False
    """Measure with fewer repetitions and without training."""
    stages: bool = False
    """Measure the stages of a frame instead: milliseconds of each on one thread."""
    out: Path | None = None
    """Also write the JSON to this .json file, replacing it."""

    def run(self) -> int:
        from thalweg.bench.speed.speed_table import speed

        if self.out is not None:
            check_file("--out", self.out, ".json")
        return speed(as_json=self.json, quick=self.quick, out=self.out, stages=self.stages)
