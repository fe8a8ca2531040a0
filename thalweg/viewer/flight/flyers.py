"""Pilots of flights on the page: the hand, scripted pilots, or a recorded flight. Policies are in `policy_flyer`."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from thalweg.env import EnvConfig
from thalweg.env.spaces import from_unit_actions
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.flight import Flight
from thalweg.viewer.flight.recording import Recording

HAND, REPLAY = "hand", "replay"
PILOTS = {"pilot": "scripted", "steady": "steady"}
"""Pilots by the names that the page and evaluations have for them."""
STILL = (0.0, 0.0, 0.0, 0.0)


class Flyer(Protocol):
    """Chooses the next action of a flight."""

    name: str
    """Name in the list of the page."""

    def action(self, flight: Flight) -> np.ndarray | None:
        """Return an action [4] of the flight's action space; None if there is none left."""
        ...


def action_of(config: EnvConfig, units: Sequence[float]) -> np.ndarray:
    """Return an action [4] of the space of `config` for what a hand does: four numbers in -1..1, +1 = up, turn left,
    forward, left, of which discrete actions take the nearest option.

    In a task with a fast step, which has no backward, -1 forward is a fast step.
    """
    asked = np.asarray(units, np.float64)[None]
    if config.action == "multidiscrete":
        asked = np.rint(asked)
    return from_unit_actions(config.action, asked, config.fast_ratio)[0]


class Hand:
    """Flies as keys and sticks say. A key that is released before the next step counts for one step."""

    name = HAND

    def __init__(self) -> None:
        self.held: Sequence[float] = STILL
        """[4] what is held now, as `action_of` takes it."""
        self._tapped = list(STILL)

    def hold(self, units: Sequence[float]) -> None:
        """Note what is held from now on [4]."""
        self.held = units
        self._tapped = [now or before for now, before in zip(units, self._tapped, strict=True)]

    def forget_taps(self) -> None:
        """Forget what was held for a moment since the last step."""
        self._tapped = list(STILL)

    def action(self, flight: Flight) -> np.ndarray:
        """Return the action of what is held, or was since the last step."""
        units = [now or before for now, before in zip(self.held, self._tapped, strict=True)]
        self.forget_taps()
        return action_of(flight.env.config, units)


class Pilot:
    """A pilot that knows the map."""

    def __init__(self, name: str) -> None:
        """`name`: one of `PILOTS`."""
        self.name = name

    def action(self, flight: Flight) -> np.ndarray:
        """Return what the pilot would do now; raises `ConfigError` for one that the vehicle has not."""
        return flight.env.pilot_actions(PILOTS[self.name])[0]


class Replay:
    """Repeats a recorded flight."""

    name = REPLAY

    def __init__(self, recording: Recording, flight: Flight) -> None:
        """Raises `ViewerError` for a flight in another river, or one that is not at its start."""
        recording.check_river(flight.world)
        if flight.steps:
            raise ViewerError("a recorded flight is repeated from its start only")
        self._recording = recording

    def action(self, flight: Flight) -> np.ndarray | None:
        """Return the action of the same step, None after the last one; raises `ViewerError` if the flight has come to
        another pose than the recorded one."""
        self._recording.check_repeats(flight)
        actions = self._recording.actions
        return actions[flight.steps] if flight.steps < len(actions) else None
