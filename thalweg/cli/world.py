"""`thalweg world`: a river from above."""

from dataclasses import dataclass
from pathlib import Path

from thalweg.cli.command import Command
from thalweg.cli.options import NO_FILE, River, UsageError, check_file, load_world
from thalweg.core.notices import notice


@dataclass(frozen=True)
class DrawWorld(Command):
    """Draw a river from above: centre line, widths, bridges and islands."""

    level: str | None = None
    """Easy, Medium or Hard. Medium by default."""
    seed: int | None = None
    """Seed of the river; by default the fixed river of the level. With --river: of its plants and hills."""
    river: River = NO_FILE
    out: Path = Path("map.png")
    """Picture to write, a .png file; an existing one is replaced."""
    save: Path | None = None
    """Also save the world to this .npz file, which must not exist."""
    overwrite: bool = False
    """Let --save replace an existing file."""

    def run(self) -> int:
        from thalweg.world.map_image import draw

        check_file("--out", self.out, ".png")
        if self.save is not None:
            check_file("--save", self.save, ".npz")
            if self.save.exists() and not self.overwrite:
                raise UsageError(f"--save {self.save} exists already; name a new file, or add --overwrite")
        reach = self.river.reach("--level", self.level, levels_have_banks=True)
        world = load_world(self.river, self.level, self.seed)
        draw(world, self.out)
        print(f"{self.out}: {world.name}, seed {world.seed}, a course of {world.river.length_m:.0f} m")
        if reach is not None:
            for note in reach.notes():
                notice(f"{reach.name}: {note}")
        if self.save is not None:
            world.save(self.save)
            print(f"{self.save}: the world")
        return 0
