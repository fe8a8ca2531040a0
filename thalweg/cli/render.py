"""`thalweg render`: what the camera sees at chosen poses."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from thalweg.cli.command import Command
from thalweg.cli.options import NO_FILE, POSE, Plugins, River, UsageError, check_file, checked_task, load_world
from thalweg.cli.views import camera_from
from thalweg.core.atomic_io import write_picture
from thalweg.core.notices import notice

PICTURES = (".png", ".jpg", ".jpeg", ".webp")


@dataclass(frozen=True)
class RenderFrames(Command):
    """Draw the camera's views: a grid of frames above their water masks, or a gallery of looks."""

    level: str | None = None
    """Easy, Medium or Hard. Medium by default."""
    seed: int | None = None
    """Seed of the river; by default the fixed river of the level. With --river: of its plants and hills."""
    river: River = NO_FILE
    pose: POSE | None = None
    """Pose of the camera: x, y, z in metres and yaw in radians; random poses by default."""
    poses: Literal["random", "pilot"] = "random"
    """Source of the poses if none is given: random safe starts, or flights of the scripted pilot, 50 steps each."""
    count: int = 8
    """Number of poses."""
    poses_seed: int = 0
    """Seed of the random poses, or of the pilot's flights."""
    task: str = "River"
    """Swimmers, Nests or Portage: also draw what stands in the river for this task, by --poses-seed."""
    vehicle: Literal["uav", "asv"] = "uav"
    """Vehicle whose starts or flights the poses are: `asv` is a boat, for Easy, Medium-Deep and Hard-Deep."""
    size: int = 128
    """Height and width of a frame in pixels."""
    quality: Literal["full", "fast"] = "full"
    """`fast` reflects only the sky, filters less, and interpolates the ground."""
    camera: tuple[str, ...] = ()
    """Settings of the camera, such as fov_deg=75 pitch_deg=10, and before them the YAML file of a calibration."""
    randomise: bool = False
    """Vary light, water, plants, camera angles, noise and clouds from frame to frame, by --poses-seed."""
    frames: Path | None = None
    """Also write each frame into this folder: colours, water mask, depth and class as PNG, and a table of poses."""
    gallery: bool = False
    """Draw a gallery instead: one view at both ends of each range of domain randomisation."""
    out: Path = Path("frames.png")
    """Picture to write, .png, .jpg or .webp; an existing one is replaced."""
    plugin: Plugins = ()

    def run(self) -> int:
        self._check()
        world = load_world(self.river, self.level, self.seed, self.vehicle)
        if self.pose is not None and not world.covers(*self.pose[:2]):
            raise UsageError(f"--pose: x = {self.pose[0]:g}, y = {self.pose[1]:g} is outside the map of {world.name}")
        self._warn_of_enclosure(world)
        poses = self._poses(world)
        if self.gallery:
            self._write_gallery(world, poses[0])
        else:
            self._write_frames(world, poses)
        return 0

    def _check(self) -> None:
        """Raise `UsageError` for options that do not go together, or a picture that cannot be written."""
        from thalweg.render.records.camera import LIMITS_PX

        if self.count < 1:
            raise UsageError(f"--count must be at least 1, not {self.count}")
        least, most = LIMITS_PX
        if not least <= self.size <= most:
            raise UsageError(f"--size must be from {least} to {most}, not {self.size}")
        if self.gallery and (self.frames is not None or self.quality != "full" or self.randomise):
            raise UsageError(
                "--gallery draws one view in the full quality: leave out --frames, --quality and --randomise"
            )
        task = checked_task(self.task)  # one that cannot be is refused before the river is built
        if self.gallery and (task != "River" or self.count != type(self).count):
            raise UsageError("--gallery draws one view without objects: leave out --task and --count")
        if self.camera and self.size != type(self).size:
            raise UsageError("--size goes without --camera, which has height_px and width_px")
        self._camera  # noqa: B018  a camera that cannot be is refused before the river is built
        if self.pose is not None and self.poses != "random":
            raise UsageError(f"give --pose or --poses {self.poses}, not both")
        check_file("--out", self.out, *PICTURES)

    def _warn_of_enclosure(self, world: Any) -> None:
        """Warn of a given pose that is under the ground or water, or inside something; it is drawn all the same."""
        from thalweg.world.enclosure import enclosure_of

        if self.pose is not None and (around := enclosure_of(world, *self.pose[:3])) is not None:
            notice(
                f"Warning: --pose: z = {self.pose[2]:g} is {around.name}; there, z above {around.top_m:.2f} is in the"
                " open"
            )

    def _poses(self, world: Any) -> Any:
        """Return the camera poses [K, 4]."""
        import numpy as np

        from thalweg.env import EnvConfig, sample_starts
        from thalweg.env.pilot.flight_poses import pilot_poses

        if self.pose is not None:
            return np.array([self.pose])
        if self.poses == "pilot":
            return pilot_poses(world, self.count, self.poses_seed, self.vehicle)
        return sample_starts(world, self.count, self.poses_seed, EnvConfig(vehicle=self.vehicle))

    def _write_gallery(self, world: Any, pose: Any) -> None:
        from thalweg.bench.pictures.gallery import gallery

        write_picture(self.out, gallery(world, pose, self._camera))
        print(f"{self.out}: the ranges of domain randomisation in {world.name}, seed {world.seed}")

    def _write_frames(self, world: Any, poses: Any) -> None:
        from thalweg.bench.pictures.contact_sheet import contact_sheet
        from thalweg.bench.pictures.frame_files import write_frames, write_poses
        from thalweg.render import Renderer

        worlds, looks = self._looks(world, len(poses))
        renderer, options = Renderer(worlds, self._camera, self.quality), looks | self._props(world, poses)
        frames = renderer.render(poses, **options)
        if self.frames is not None:
            write_frames(self.frames, frames, renderer.render_layers(poses, layers=("depth_m", "class_id"), **options))
            write_poses(self.frames, poses)
        write_picture(self.out, contact_sheet(frames))
        for x, y, z, yaw in poses:
            print(f"--pose {x:.3f} {y:.3f} {z:.3f} {yaw:.4f}")
        print(f"{self.out}: {len(frames)} frames of {world.name}, seed {world.seed}")

    def _looks(self, world: Any, count: int) -> tuple[list[Any], dict[str, Any]]:
        """Return the world under each of its suns, and what the renderer is given of a random look for each frame."""
        import numpy as np

        from thalweg.env.frame_renderer import relit_worlds
        from thalweg.render import Randomisation

        if not self.randomise:
            return [world], {}
        ranges, generator = Randomisation(), np.random.default_rng(self.poses_seed)
        looks, suns = zip(*(ranges.draw(generator) for _ in range(count)), strict=True)
        return relit_worlds([world], ranges), {"look": np.array(looks), "world_index": np.array(suns)}

    def _props(self, world: Any, poses: Any) -> dict[str, Any]:
        """Return the objects [K, P, 6] of the task about poses [K, 4] for the renderer, if there are any."""
        from thalweg.env import EnvConfig, RiverVectorEnv

        if self.task == "River":
            return {}
        rules = EnvConfig(observation="none", task=checked_task(self.task))
        env = RiverVectorEnv(world, len(poses), rules)
        env.reset(seed=self.poses_seed)
        env.state.pose[:] = poses
        props = env.props()
        return {} if props is None else {"props": props}

    @property
    def _camera(self) -> Any:
        from thalweg.render import Camera

        return camera_from(self.camera) if self.camera else Camera(height_px=self.size, width_px=self.size)
