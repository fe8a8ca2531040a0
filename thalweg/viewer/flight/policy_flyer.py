"""A policy that flies: it sees what it was trained on, whichever frames the page shows."""

from typing import Any

import numpy as np
import torch

from thalweg.bench.evaluate.baselines import DRAWN, Policy, RecurrentPolicy, sight_of
from thalweg.bench.evaluate.evaluation import player_of
from thalweg.encoder import VAE, Encoder
from thalweg.env.pilot.in_rivers import PILOTS
from thalweg.env.spaces import CHANNELS, from_unit_actions
from thalweg.train.encoder_of_run import encoder_of
from thalweg.train.errors import TrainingError
from thalweg.train.observations import action_of, camera_of, check_policy_fits, feels, observation_of
from thalweg.train.river import load_compatible_encoder
from thalweg.viewer.flight.eye import Eye
from thalweg.viewer.flight.flight import Flight


class PolicyFlyer:
    """A policy with a memory of its own, which begins where it takes over."""

    def __init__(self, name: str, policy: Policy | RecurrentPolicy, flight: Flight, eye: Eye | None = None) -> None:
        """Check that the policy fits the flight; `eye`: that of an earlier flight in the same environment, if any.

        Raises `TrainingError` for a policy of another vehicle or observation, and the errors of its encoder.
        """
        self.name, self._policy = name, policy
        self._sees, options = sight_of(policy), flight.options
        self._encoder: Encoder | None = None
        if self._sees == "frames":
            self._encoder = load_compatible_encoder(encoder_of(policy))
        fits: dict[str, Any] = {"task": options.task, "vehicle": options.vehicle, "dynamics": options.dynamics}
        check_policy_fits(policy, self._encoder, action=action_of(policy), **fits)
        self._numbers = action_of(policy) == "continuous"
        if self._numbers and flight.env.config.action != "continuous":
            raise TrainingError(
                "the policy has continuous actions, but those of the flight are discrete: fly with continuous ones"
            )
        self._feels = feels(policy)
        self._channels = self._channels_seen()
        camera = camera_of(policy, self._encoder)
        self.eye = eye if eye is not None and eye.serves(flight, camera) else Eye(flight, camera)
        self._play = player_of(policy, torch.Generator().manual_seed(options.seed))
        self._fresh = True
        self.seen: np.ndarray | None = None
        """[H, W, C] uint8, the image that the last action was chosen by; None for a policy that sees none."""
        self._codes: np.ndarray | None = None

    def action(self, flight: Flight) -> np.ndarray:
        """Return the policy's action in the current state, in the flight's action space."""
        options = self._play(self._observed(flight), np.array([self._fresh]))
        self._fresh = False
        return np.asarray(options)[0] if self._numbers else self._in_space(np.asarray(options), flight)[0]

    def _channels_seen(self) -> int:
        if self._sees == "images":
            return CHANNELS[observation_of(self._policy)]
        return 1 if self._encoder is not None and self._encoder.inputs == "mask" else 4

    def _observed(self, flight: Flight) -> np.ndarray:
        """Return the observation [1, ...] that the policy takes."""
        env = flight.env
        if self._sees in DRAWN:
            frames = self.eye.see(flight, self._channels)
            self.seen, seen = frames[0], frames
            if self._encoder is not None:
                seen = self._codes = self._encoder.of_tensor(torch.from_numpy(frames)).numpy()
        elif self._sees == "privileged":
            seen = env.ideal_eye()
        elif self._sees in PILOTS["uav"]:
            seen = env.pilot_actions(self._sees)
        else:
            seen = np.zeros((1, 0), np.float32)
        return np.concatenate([seen, env.observe()["proprioception"]], axis=1) if self._feels else seen

    def decoded(self) -> np.ndarray | None:
        """Return what the autoencoder makes of the code [H, W, C] that the last action was chosen by; None without."""
        if self._encoder is None or self._codes is None or not isinstance(self._encoder.model, VAE):
            return None
        return self._encoder.decode(self._codes)[0]

    @staticmethod
    def _in_space(options: np.ndarray, flight: Flight) -> np.ndarray:
        """Return options [1, 4] of four branches as actions of the flight's space."""
        config = flight.env.config
        if config.action == "multidiscrete":
            return options.astype(np.int64)
        return from_unit_actions(config.action, 1.0 - options, config.fast_ratio)
