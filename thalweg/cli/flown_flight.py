"""Options of flights that a command flies: by a policy, a pilot, or as they were saved."""

from dataclasses import dataclass, fields, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from tyro.conf import Positional

from thalweg.cli.flight_options import ChosenFlight, free_name
from thalweg.cli.options import NO_FILE, UsageError

SAVED = ".npz"
"""Ending of files of flights that `thalweg fly` saved."""


@dataclass(frozen=True)
class FlownFlight(ChosenFlight):
    """A flight, and who flies it."""

    flight: Positional[str] = "packaged"
    """A run's folder, policy or .npz file, a function (fly.py:fly), packaged, packaged-rgb, pilot, steady or hover."""

    @property
    def saved(self) -> bool:
        """Whether the flight is one that was saved."""
        return Path(self.flight).suffix == SAVED

    def cockpit(self, size_px: int, folder: Path) -> Any:
        """Return a cockpit at the start of the flight; `folder` is where it would save flights.

        Raises the errors of `cockpits`, and of a saved flight that cannot be read.
        """
        return self._repeated(size_px, folder) if self.saved else next(self.cockpits(size_px, folder, [{}]))

    def cockpits(self, size_px: int, folder: Path, changes: Any) -> Any:
        """Yield the cockpit at the start of each flight; `changes` has a mapping for each, of the options that differ.

        The same cockpit and policy fly all of them. Raises the errors of `chosen`, and of the policy.
        """
        from thalweg.cli.evaluate import load_named_policy
        from thalweg.viewer.flight.cockpit import Cockpit
        from thalweg.viewer.flight.flyers import HAND, PILOTS, REPLAY
        from thalweg.viewer.flight.recording import Folder

        piloted = self.flight in PILOTS
        name = self.flight if piloted else free_name(self.flight, (HAND, REPLAY, *PILOTS))
        policies = {} if piloted else {name: cache(partial(load_named_policy, self.flight, self.vehicle or "uav"))}
        given = None if piloted else policies[name]()  # its errors show before anything is built
        rivers, options = self.chosen(size_px, given)
        options = options if piloted else self.with_actions_of(options, {self.flight: given})
        cockpit = Cockpit(policies, Folder(folder), name)
        for change in changes:
            flown = replace(options, **change)
            cockpit.start(rivers.world(flown.level, flown.world_seed), flown)
            yield cockpit

    def _repeated(self, size_px: int, folder: Path) -> Any:
        """Return a cockpit in which a saved flight is repeated; raises `UsageError` for options beside it."""
        from thalweg.viewer.flight.cockpit import Cockpit
        from thalweg.viewer.flight.recording import Folder, read_recording
        from thalweg.viewer.flight.rivers import Rivers

        free = ("river", "quality", "plugin")
        for field in fields(ChosenFlight):
            if field.name not in free and getattr(self, field.name) != field.default:
                option = f"--{field.name.replace('_', '-')}"
                raise UsageError(f"{option} does not go with {self.flight}, a flight with options of its own")
        recording = read_recording(Path(self.flight))
        options = replace(recording.options, size_px=size_px, quality=self.quality)
        rivers = Rivers(self.river.reach("--level", None) if self.river != NO_FILE else None)
        cockpit = Cockpit({}, Folder(folder))
        cockpit.repeat(rivers.world(options.level, options.world_seed), replace(recording, options=options))
        return cockpit
