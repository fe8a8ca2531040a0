"""Commands that draw: a river from above, and what the camera sees of it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from thalweg.cli.options import NO_FILE, POSE, River, RiverFile, UsageError, check_file
from thalweg.core.atomic_io import atomic_path

PICTURES = (".png", ".jpg", ".jpeg", ".webp")


@dataclass(frozen=True)
class DrawWorld:
    """Draw a river from above: centre line, widths, bridges and islands."""

    level: str | None = None
    """Easy, Medium or Hard; Medium if neither level nor file is given."""
    seed: int | None = None
    """Which river of the level; its fixed one if not given. Of a file: its plants and hills."""
    river: River = NO_FILE
    out: Path = Path("map.png")
    """The picture, a PNG; one that is there is replaced."""
    save: Path | None = None
    """Also write the world itself to this .npz file, which must be a new one."""
    overwrite: bool = False
    """Let --save replace a file that is there."""

    def run(self) -> int:
        from thalweg.world.map_image import draw

        check_file("--out", self.out, ".png")
        if self.save is not None:
            check_file("--save", self.save, ".npz")
            if self.save.exists() and not self.overwrite:
                raise UsageError(f"--save {self.save} is there already; name a new file, or replace it by --overwrite")
        world = _world(self.river, self.level, self.seed)
        draw(world, self.out)
        print(f"{self.out}: {world.name}, seed {world.seed}, a course of {world.river.length_m:.0f} m")
        if self.save is not None:
            world.save(self.save)
            print(f"{self.save}: the world")
        return 0


@dataclass(frozen=True)
class RenderFrames:
    """Draw what the camera sees: a sheet of frames, each above its water mask, or a gallery of looks."""

    level: str | None = None
    """Easy, Medium or Hard; Medium if neither level nor file is given."""
    seed: int | None = None
    """Which river of the level; its fixed one if not given. Of a file: its plants and hills."""
    river: River = NO_FILE
    pose: POSE | None = None
    """x y z yaw in metres and radians; random poses if not given."""
    poses: Literal["random", "pilot"] = "random"
    """Where the camera is when no pose is given: at random safe starts, or on the scripted pilot's flights from such
    starts, 50 steps each."""
    count: int = 8
    """How many poses."""
    poses_seed: int = 0
    """Which random poses."""
    size: int = 128
    """Height and width of a frame in pixels."""
    quality: Literal["full", "fast"] = "full"
    """fast: without reflections, filtered less, and marched once for four pixels."""
    frames: Path | None = None
    """Also write each frame by itself, as a PNG, into this folder."""
    gallery: bool = False
    """Draw one view at both ends of each range of domain randomisation instead."""
    out: Path = Path("frames.png")
    """The picture, .png, .jpg or .webp; one that is there is replaced."""

    def run(self) -> int:
        import numpy as np

        from thalweg.bench.pictures.contact_sheet import contact_sheet, write_frames
        from thalweg.env import sample_starts
        from thalweg.render import Camera, Renderer

        if self.count < 1:
            raise UsageError("--count must be at least 1")
        if self.gallery and (self.frames is not None or self.quality != "full"):
            raise UsageError("--gallery draws one view in the full quality: leave out --frames and --quality")
        if self.pose is not None and self.poses != "random":
            raise UsageError(f"give --pose or --poses {self.poses}, not both")
        check_file("--out", self.out, *PICTURES)
        world = _world(self.river, self.level, self.seed)
        if self.pose is not None and not world.covers(*self.pose[:2]):
            raise UsageError(f"--pose: x = {self.pose[0]:g}, y = {self.pose[1]:g} is outside the map of {world.name}")
        if self.pose is not None:
            chosen = np.array([self.pose])
        elif self.poses == "pilot":
            from thalweg.env.pilot.flight_poses import pilot_poses

            chosen = pilot_poses(world, self.count, self.poses_seed)
        else:
            chosen = sample_starts(world, self.count, self.poses_seed)
        camera = Camera(height_px=self.size, width_px=self.size)
        if self.gallery:
            from thalweg.bench.pictures.gallery import gallery

            with atomic_path(self.out) as draft:
                gallery(world, chosen[0], camera).save(draft)
            print(f"{self.out}: the ranges of domain randomisation in {world.name}, seed {world.seed}")
            return 0
        frames = Renderer([world], camera, self.quality).render(chosen)
        if self.frames is not None:
            write_frames(self.frames, frames)
        with atomic_path(self.out) as draft:
            contact_sheet(frames).save(draft)
        for x, y, z, yaw in chosen:
            print(f"--pose {x:.3f} {y:.3f} {z:.3f} {yaw:.4f}")
        print(f"{self.out}: {len(frames)} frames of {world.name}, seed {world.seed}")
        return 0


def _world(river: RiverFile, level: str | None, seed: int | None) -> Any:
    """The world of the file, or that of the level and seed."""
    from thalweg.world import level_named, load_or_build

    if (reach := river.reach("--level", level)) is not None:
        return reach.build(seed or 0)
    chosen = level_named(level or "Medium")
    return load_or_build(chosen, chosen.default_seed if seed is None else seed)
