"""`thalweg record`: records flights as a data set of LeRobot or Minari."""

import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from thalweg.cli.flight_options import policy_name
from thalweg.cli.flown_files import flown_files
from thalweg.cli.flown_flight import FlownFlight
from thalweg.cli.options import UsageError
from thalweg.cli.views import camera_from
from thalweg.core.config import to_plain
from thalweg.core.notices import notice
from thalweg.core.seeds import parse_seeds

if TYPE_CHECKING:
    from thalweg.render import Camera


@dataclass(frozen=True)
class Record(FlownFlight):
    """Record flights of a policy or a pilot, or one that `thalweg fly` saved, as a data set of LeRobot or Minari."""

    out: Path = Path("recordings")
    """Folder to write, new or empty, which Minari takes as the name of the data set; the same command resumes."""
    format: Literal["lerobot", "minari"] = "lerobot"
    """Format of the data set: LeRobot's of version 3.0, or Minari's."""
    episodes: int = 10
    """Number of flights; their seeds are --seed, --seed + 1 and so on."""
    world_seeds: tuple[str, ...] = ()
    """Seeds of rivers, such as 1000:1010, one for each flight in turn; in place of --world-seed."""
    steps: int | None = None
    """Greatest number of steps of each flight; by default to its end."""
    layers: tuple[Literal["mask", "depth", "class"], ...] = ("mask", "depth", "class")
    """What to keep beside the colours."""
    size: int = 128
    """Height and width of a frame in pixels."""
    camera: tuple[str, ...] = ()
    """Calibration and settings of the recorded camera, such as a.yaml pitch_deg=10; policies see through their own."""
    video: bool = False
    """Keep the colours as an H.264 video, which is smaller and lossy; else every frame is lossless."""

    resumes = True

    def after_interrupt(self) -> str:
        from thalweg.datasets.draft import finished_flights

        if finished := len(finished_flights(self.out)):
            return f"Flights that are finished: {finished}. The same command records the others."
        return "No flight was finished; the same command starts from the beginning."

    def run(self) -> int:
        from rich.console import Console

        from thalweg.bench.evaluate.progress import progress_bar
        from thalweg.datasets.draft import finished_flights
        from thalweg.datasets.errors import DatasetError
        from thalweg.datasets.recordings import check_recording, recording
        from thalweg.viewer.flight.observed import Observer
        from thalweg.viewer.flight.recording import read_recording

        camera = self._checked_camera()
        check_recording(self.out, self.format, video=self.video)
        count = 1 if self.saved else self.episodes
        done = finished_flights(self.out)
        flights = self._flights(min(len(done), count - 1))
        first = next(flights)  # errors of options show before the folder is made
        pilots = read_recording(Path(self.flight)).pilots if self.saved else None  # not the one who repeats it
        observer = Observer(first.flight.env, camera, self.layers)
        ended, steps = Counter(_end(each["reason"]) for each in done), sum(each["steps"] for each in done)
        if done:
            notice(f"Resuming after {len(done)} of {max(count, len(done))} flights")
        with (
            progress_bar(Console(stderr=True), "flights") as progress,
            recording(
                self.out,
                self.format,
                observer.about(),
                video=self.video,
                options=self._what_is_flown(first.flight.options),
                files=flown_files(self.flight, self.river.river, self.plugin),
            ) as writer,
        ):
            if writer.finished != len(done):
                raise DatasetError(f"{self.out}: another command recorded flights there; run the command again")
            task = progress.add_task(self.out.name, total=count, completed=writer.finished, rate="")
            for cockpit in itertools.chain([first], flights) if writer.finished < count else ():
                flight = cockpit.flight
                if flight.env is not observer.env:
                    observer = Observer(flight.env, camera, self.layers)
                with writer.flight(flight.options.task, observer.options_of(flight)) as written:
                    steps += observer.record(cockpit, written, self.steps, pilots)
                ended[_end(flight.reason)] += 1
                progress.update(task, advance=1, rate=f"{steps:,} steps")
            count = writer.finished
        told = ", ".join(f"{number} {reason}" for reason, number in sorted(ended.items()))
        print(f"{self.out}: {count} flights, {steps:,} steps ({told}) in the format of {self.format}")
        return 0

    def _what_is_flown(self, flown: Any) -> dict[str, Any]:
        """Return the options that decide what the flights are, as plain data: not their number, nor the folders in
        which files lie. The camera is kept beside them; `flown` are the options of the first flight, in which those
        that follow from the policy are resolved."""
        ways = ("out", "format", "episodes", "video", "plugin", "size", "camera")
        resolved = {name: getattr(flown, name) for name in ("task", "vehicle", "action")}
        changes: dict[str, Any] = {"flight": policy_name(self.flight), **resolved}
        named = replace(self, **changes)
        return {each.name: _plain(getattr(named, each.name)) for each in fields(self) if each.name not in ways}

    def _checked_camera(self) -> "Camera":
        """Return the recorded camera; raises `UsageError` for options that do not go together, and the errors of
        `camera_from`."""
        if self.episodes < 1:
            raise UsageError(f"--episodes must be at least 1, not {self.episodes}")
        if self.steps is not None and self.steps < 1:
            raise UsageError(f"--steps must be at least 1, not {self.steps}")
        if self.world_seeds and self.world_seed is not None:
            raise UsageError("give --world-seed or --world-seeds, not both")
        if self.saved and (self.world_seeds or self.episodes != type(self).episodes):
            raise UsageError(f"--episodes and --world-seeds do not go with {self.flight}, which is one flight")
        if self.camera and self.size != type(self).size:
            raise UsageError("--size goes without --camera, which has height_px and width_px")
        camera = camera_from(self.camera) if self.camera else self._square_camera()
        if self.video and (camera.height_px % 2 or camera.width_px % 2):
            size = f"{camera.height_px} x {camera.width_px} pixels (height x width)"
            raise UsageError(f"--video needs frames with an even height and width, not {size}")
        return camera

    def _square_camera(self) -> "Camera":
        """Return the camera of --size; raises `UsageError` for a size that it cannot have."""
        from thalweg.render import Camera
        from thalweg.render.errors import RenderError

        try:
            return Camera(self.size, self.size)
        except RenderError as error:
            raise UsageError(str(error).partition("; ")[0].replace("height_px", "--size")) from error

    def _flights(self, first: int) -> Iterator[Any]:
        """Yield the cockpit at the start of each flight, from the one with the index `first` on."""
        policy_sees = 128  # its own eye has its own size
        if self.saved:
            yield self.cockpit(policy_sees, self.out.parent)
            return
        seeds = parse_seeds(self.world_seeds, "--world-seeds", UsageError) if self.world_seeds else [self.world_seed]
        changes = [
            {"seed": self.seed + number, "world_seed": seeds[number % len(seeds)]}
            for number in range(first, self.episodes)
        ]
        yield from self.cockpits(policy_sees, self.out.parent, changes)


def _end(reason: int) -> str:
    """Return how a flight ended, in words, by the code of the reason."""
    from thalweg.bench.evaluate.episodes import ALL_REASONS, REASON_TEXT

    return REASON_TEXT[ALL_REASONS[reason]] if reason >= 0 else "stopped"


def _plain(value: Any) -> Any:
    """Return an option as data for JSON; of a file, its name."""
    value = to_plain(value)
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return value.name if isinstance(value, Path) else value
