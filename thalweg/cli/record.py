"""`thalweg record`: records flights as a data set of LeRobot or Minari."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from thalweg.cli.flown_flight import FlownFlight
from thalweg.cli.options import UsageError
from thalweg.core.seeds import parse_seeds


@dataclass(frozen=True)
class Record(FlownFlight):
    """Record flights of a policy or a pilot, or one that `thalweg fly` saved, as a data set of LeRobot or Minari."""

    out: Path = Path("recordings")
    """Folder to write, which must be new or empty; Minari takes its name as that of the data set."""
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
    fov_deg: float = 60.0
    """Vertical field of view of the recorded camera in degrees; policies see through the camera of their training."""
    pitch_deg: float = 20.0
    """How far the recorded camera looks below the horizon, in degrees."""
    video: bool = False
    """Keep the colours as an H.264 video, which is smaller and lossy; else every frame is lossless."""

    def run(self) -> int:
        from rich.console import Console

        from thalweg.bench.evaluate.progress import progress_bar
        from thalweg.datasets.recordings import check_recording, recording
        from thalweg.render import Camera
        from thalweg.viewer.flight.observed import Observer
        from thalweg.viewer.flight.recording import read_recording

        self._check()
        check_recording(self.out, self.format, video=self.video)
        camera = Camera(height_px=self.size, width_px=self.size, fov_deg=self.fov_deg, pitch_deg=self.pitch_deg)
        count = 1 if self.saved else self.episodes
        flights = self._flights()
        first = next(flights)  # errors of options show before the folder is made
        observer = Observer(first.flight.env, camera, self.layers)
        reasons: dict[str, int] = {}
        steps = 0
        with (
            progress_bar(Console(stderr=True), "flights") as progress,
            recording(self.out, self.format, observer.about(), video=self.video) as writer,
        ):
            task = progress.add_task(self.out.name, total=count, rate="")
            for cockpit in itertools.chain([first], flights):
                if cockpit.flight.env is not observer.env:
                    observer = Observer(cockpit.flight.env, camera, self.layers)
                episode = observer.record(cockpit, self.steps)
                if self.saved:  # the repeating pilot is not who flew it
                    episode = replace(episode, pilots=read_recording(Path(self.flight)).pilots[: episode.steps])
                writer.add(episode)
                ended = cockpit.flight.status()["ended"] or "stopped"
                reasons[ended] = reasons.get(ended, 0) + 1
                steps += episode.steps
                progress.update(task, advance=1, rate=f"{steps:,} steps")
        told = ", ".join(f"{number} {reason}" for reason, number in sorted(reasons.items()))
        print(f"{self.out}: {count} flights, {steps:,} steps ({told}) in the format of {self.format}")
        return 0

    def _check(self) -> None:
        """Raise `UsageError` for options that do not go together."""
        if self.episodes < 1:
            raise UsageError(f"--episodes must be at least 1, not {self.episodes}")
        if self.steps is not None and self.steps < 1:
            raise UsageError(f"--steps must be at least 1, not {self.steps}")
        if self.video and self.size % 2:
            raise UsageError(f"--video needs an even --size, not {self.size}")
        if self.world_seeds and self.world_seed is not None:
            raise UsageError("give --world-seed or --world-seeds, not both")
        if self.saved and (self.world_seeds or self.episodes != type(self).episodes):
            raise UsageError(f"--episodes and --world-seeds do not go with {self.flight}, which is one flight")

    def _flights(self) -> Iterator[Any]:
        """Yield the cockpit at the start of each flight."""
        policy_sees = 128  # its own eye has its own size
        if self.saved:
            yield self.cockpit(policy_sees, self.out.parent)
            return
        seeds = parse_seeds(self.world_seeds, "--world-seeds", UsageError) if self.world_seeds else [self.world_seed]
        changes = [
            {"seed": self.seed + number, "world_seed": seeds[number % len(seeds)]} for number in range(self.episodes)
        ]
        yield from self.cockpits(policy_sees, self.out.parent, changes)
