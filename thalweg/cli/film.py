"""`thalweg film`: a film of a flight, by a policy, a pilot, or as it was recorded."""

from dataclasses import dataclass
from pathlib import Path

from thalweg.cli.flight_options import policy_name
from thalweg.cli.flown_flight import FlownFlight
from thalweg.cli.options import UsageError, check_file


@dataclass(frozen=True)
class Film(FlownFlight):
    """Film a flight of a policy or a pilot in any river and look, or a flight that `thalweg fly` saved."""

    steps: int | None = None
    """Greatest number of steps; by default to the end of the flight."""
    fov_deg: float = 60.0
    """Vertical field of view of the filming camera in degrees; policies see through the camera of their training."""
    pitch_deg: float = 20.0
    """How far the filming camera looks below the horizon, in degrees."""
    out: Path = Path("flight.mp4")
    """Film to write, an .mp4 file; an existing one is replaced. A picture of it is written beside it."""

    def run(self) -> int:
        from rich.console import Console

        from thalweg.bench.evaluate.progress import progress_bar, track_frames
        from thalweg.bench.pictures.film_format import LARGE
        from thalweg.render import Camera
        from thalweg.viewer.flight.filming import FilmedFlight

        check_file("--out", self.out, ".mp4")
        if self.steps is not None and self.steps < 1:
            raise UsageError(f"--steps must be at least 1, not {self.steps}")
        side = LARGE.view_px
        camera = Camera(height_px=side, width_px=side, fov_deg=self.fov_deg, pitch_deg=self.pitch_deg)
        filmed = FilmedFlight(self.cockpit(side, self.out.parent), self.steps, camera)
        with progress_bar(Console(stderr=True), "frames") as progress:
            on_frame = track_frames(progress, self.out.name, filmed.flight.steps)
            filmed.write(self.out, policy_name(self.flight), on_frame)
        told, options = filmed.flight.status(), filmed.flight.options
        costs = ", ".join(f"{kind} {cost:.2f}" for kind, cost in told["costs"].items())
        print(
            f"{self.out}: {filmed.flight.steps} steps on {options.level}, start {options.seed}:"
            f" {told['ended'] or 'not ended'}, return {told['return']:.2f}, costs {costs}"
        )
        return 0
