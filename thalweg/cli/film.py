"""`thalweg film`: a film of a flight, by a policy, a pilot, or as it was recorded."""

from dataclasses import dataclass
from pathlib import Path

from thalweg.cli.flight_options import policy_name
from thalweg.cli.flown_flight import FlownFlight
from thalweg.cli.options import UsageError, check_file
from thalweg.cli.views import camera_from


@dataclass(frozen=True)
class Film(FlownFlight):
    """Film a flight of a policy or a pilot in any river and look, or a flight that `thalweg fly` saved."""

    steps: int | None = None
    """Greatest number of steps; by default to the end of the flight."""
    camera: tuple[str, ...] = ()
    """Calibration and settings of the filming camera, such as a.yaml pitch_deg=10; policies see through their own."""
    out: Path = Path("flight.mp4")
    """Film to write, an .mp4 file; an existing one is replaced. A picture of it is written beside it."""

    def run(self) -> int:
        from rich.console import Console

        from thalweg.bench.evaluate.progress import progress_bar, track_frames
        from thalweg.bench.pictures.film_format import LARGE, format_of
        from thalweg.viewer.flight.filming import FilmedFlight

        check_file("--out", self.out, ".mp4")
        if self.steps is not None and self.steps < 1:
            raise UsageError(f"--steps must be at least 1, not {self.steps}")
        camera = camera_from(self.camera, LARGE.view_px)
        format_of(camera)  # frames that make no film are refused before anything is flown
        filmed = FilmedFlight(self.cockpit(LARGE.view_px, self.out.parent), self.steps, camera)
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
