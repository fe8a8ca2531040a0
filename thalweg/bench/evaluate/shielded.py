"""The shield in evaluated flights: it is given the masks that were drawn, and tells players what they did instead.

Shielded flights are results apart: their rows say so.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from thalweg.algos.policy.player import NetworkPlayer, Player
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.baselines import sight_of
from thalweg.bench.evaluate.episodes import Episode
from thalweg.core import versions
from thalweg.env import RiverVectorEnv
from thalweg.env.shield.config import ShieldConfig
from thalweg.env.shield.moves import PERMITTED
from thalweg.env.shield.shield import DEFAULT_SHIELD, Shield
from thalweg.env.shield.sight import Optics
from thalweg.env.task.altimeter import heights_above_water
from thalweg.train.observations import IN_WORDS, observation_of


class Screening(NamedTuple):
    """What the shield made of the moves of K flights in one step."""

    flying: np.ndarray
    """[K] int64, row of the course of each flight."""
    proposed: np.ndarray
    """[K, 4] int64."""
    made: np.ndarray
    """[K, 4] int64."""
    verdicts: np.ndarray
    """[K] int64, on the proposed moves, see `thalweg.env.shield.moves.VERDICTS`."""


def check_masks(policy: Any, encoder: Any = None) -> None:
    """Raise `ResultsError` for a policy whose camera has no water masks, which the shield reads.

    A baseline sees nothing, or knows the map: masks are drawn for the shield alone. `encoder`: that of a policy of
    codes, if it is known.
    """
    sees = sight_of(policy)
    if sees == "privileged" or (sees == "images" and observation_of(policy) == "rgb"):
        raise ResultsError(
            f"the shield reads water masks, but this policy sees {IN_WORDS[observation_of(policy)]}: choose a policy of"
            " images with their mask, of codes that an encoder makes of frames with their mask, or a baseline"
        )
    if encoder is not None and encoder.inputs == "rgb":
        raise ResultsError(
            "the shield reads water masks, but the encoder of this policy sees none (rgb): choose one of rgb+mask, or"
            " of mask"
        )


def check_shield(policy: Any, observe: Any) -> None:
    """Raise `ResultsError` unless the shield has masks to read, as `check_masks`, also of an `observe` without them."""
    check_masks(policy)
    if not hasattr(observe, "masks"):
        raise ResultsError(
            "the shield reads the masks of frames: give the `observe` that observation_function(..., shielded=True)"
            " returns"
        )


def check_moves(action: str) -> None:
    """Raise `ResultsError` for an action space, see `EnvConfig.action`, of which the shield knows no moves."""
    if action != "multidiscrete":
        raise ResultsError(
            f"the shield judges the moves of multidiscrete actions, but these are {action}, as inertial dynamics need:"
            " leave the shield out, or choose kinematic dynamics"
        )


class FlightShield:
    """The shield of the flights on one course."""

    def __init__(
        self, settings: ShieldConfig = DEFAULT_SHIELD, on_screen: Callable[[Screening], None] | None = None
    ) -> None:
        """`on_screen` is called with each step's moves."""
        self.settings, self._on_screen = settings, on_screen
        self.seconds = 0.0
        """Time spent on maps and judgement."""
        self.env: RiverVectorEnv | None = None
        """The environment of the flights, once they have begun."""
        self.vetoes = np.zeros(0, np.int64)
        """[K] vetoed moves of each flight."""

    def begin(self, env: RiverVectorEnv, looks: np.ndarray | None) -> None:
        """Begin the flights of an environment, whose cameras have the looks [N, P]."""
        self.env = env
        self._shield = Shield(env.num_envs, env.config, self.settings)
        self._shield.set_looks(looks)
        self.vetoes = np.zeros(env.num_envs, np.int64)

    @property
    def optics(self) -> Optics:
        """What the shield takes the cameras to be."""
        return self._shield.optics

    def screen(self, flying: np.ndarray, observe: Any, actions: np.ndarray, players: Sequence[Player]) -> np.ndarray:
        """Return the moves [K, 4] to make in place of the `actions` [K, 4] of the flights `flying` [K].

        `observe.masks` are those of the frames that were just seen; the `players` of all flights learn what they did.
        """
        assert self.env is not None
        networks = [player for index in flying if isinstance(player := players[index], NetworkPlayer)]
        found = [player.log_probs() for player in networks] if len(networks) == len(flying) else []
        known = [each[0] for each in found if each is not None]
        log_probs = np.stack(known) if len(known) == len(flying) else None
        heights = heights_above_water(self.env.courses, self.env.state)[flying]
        began = time.perf_counter()
        made, verdicts = self._shield.screen(flying, observe.masks, heights, actions, log_probs)
        self.seconds += time.perf_counter() - began
        vetoed = verdicts != PERMITTED
        self.vetoes[flying] += vetoed
        for place in np.flatnonzero(vetoed):
            player = players[flying[place]]
            if isinstance(player, NetworkPlayer):
                player.correct(made[place : place + 1])
        if self._on_screen is not None:
            self._on_screen(Screening(flying, actions.copy(), made, verdicts))
        return made

    def marked(self, rows: list[Episode]) -> list[Episode]:
        """Return the rows of the flights, which say that they were shielded."""
        return [
            replace(row, shield=versions.SHIELD, vetoes=int(count))
            for row, count in zip(rows, self.vetoes, strict=True)
        ]
