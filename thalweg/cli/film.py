"""`thalweg film`: a film of a flight, by a policy, a pilot, or as it was recorded."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from tyro.conf import Positional

from thalweg.cli.flight_options import ChosenFlight, policy_name
from thalweg.cli.options import NO_FILE, UsageError, check_file

RECORDED = ".npz"


@dataclass(frozen=True)
class Film(ChosenFlight):
    """Film a flight of a policy or a pilot in any river and look, or a flight that `thalweg fly` saved."""

    flight: Positional[str] = "packaged"
    """A run's folder, a policy file, `packaged`, `pilot`, `steady`, or a saved flight, an .npz file."""
    steps: int | None = None
    """Greatest number of steps; by default to the end of the flight."""
    out: Path = Path("flight.mp4")
    """Film to write, an .mp4 file; an existing one is replaced. A picture of it is written beside it."""

    def run(self) -> int:
        from thalweg.bench.evaluate.progress import progress_bar, track_frames
        from thalweg.bench.pictures.film_format import LARGE
        from thalweg.cli.tables import make_console
        from thalweg.viewer.flight.filming import FilmedFlight

        check_file("--out", self.out, ".mp4")
        if self.steps is not None and self.steps < 1:
            raise UsageError(f"--steps must be at least 1, not {self.steps}")
        filmed = FilmedFlight(self._cockpit(LARGE.view_px), self.steps)
        with progress_bar(make_console(), "frames") as progress:
            on_frame = track_frames(progress, self.out.name, filmed.flight.steps)
            filmed.write(self.out, policy_name(self.flight), on_frame)
        told, options = filmed.flight.status(), filmed.flight.options
        costs = ", ".join(f"{kind} {cost:.2f}" for kind, cost in told["costs"].items())
        print(
            f"{self.out}: {filmed.flight.steps} steps on {options.level}, start {options.seed}:"
            f" {told['ended'] or 'not ended'}, return {told['return']:.2f}, costs {costs}"
        )
        return 0

    def _cockpit(self, size_px: int) -> Any:
        """Return the cockpit of the flight, which is at its start."""
        from thalweg.cli.evaluate import load_named_policy
        from thalweg.viewer.flight.cockpit import Cockpit
        from thalweg.viewer.flight.flyers import PILOTS
        from thalweg.viewer.flight.recording import Folder

        if Path(self.flight).suffix == RECORDED:
            return self._repeated(size_px)
        rivers, options = self.chosen(size_px)
        name = policy_name(self.flight)
        policies = {} if self.flight in PILOTS else {name: partial(_given, load_named_policy(self.flight))}
        cockpit = Cockpit(policies, Folder(self.out.parent), name)
        cockpit.start(rivers.world(options.level, options.world_seed), options)
        return cockpit

    def _repeated(self, size_px: int) -> Any:
        """Return a cockpit in which a saved flight is repeated; raises `UsageError` for options beside it."""
        from dataclasses import fields, replace

        from thalweg.viewer.flight.cockpit import Cockpit
        from thalweg.viewer.flight.recording import Folder, read_recording
        from thalweg.viewer.flight.rivers import Rivers

        free = ("river", "world_seed", "quality")
        for field in fields(ChosenFlight):
            if field.name not in free and getattr(self, field.name) != field.default:
                option = f"--{field.name.replace('_', '-')}"
                raise UsageError(f"{option} does not go with {self.flight}, a flight with options of its own")
        recording = read_recording(Path(self.flight))
        options = replace(recording.options, size_px=size_px, quality=self.quality)
        rivers = Rivers(self.river.reach("--level", None) if self.river != NO_FILE else None)
        cockpit = Cockpit({}, Folder(self.out.parent))
        cockpit.repeat(rivers.world(options.level, options.world_seed), replace(recording, options=options))
        return cockpit


def _given(policy: Any) -> Any:
    return policy
