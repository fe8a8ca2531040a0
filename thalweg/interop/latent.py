"""Wrapper of single environments whose observations become codes of an encoder.

`thalweg.train.LatentVectorEnv` does the same for many environments.
"""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs

from thalweg.interop.errors import InteropError
from thalweg.train.latent import FrameEncoder
from thalweg.train.parts import ObservationParts, joined, vector_space
from thalweg.train.river import load_compatible_encoder


class LatentEnv(gymnasium.ObservationWrapper, RecordConstructorArgs):
    """An environment whose observations are codes float32 [Z] of its frames.

    With P numbers beside its frames, as in `observation="rgb,mask,proprioception"`, they are [Z + P]: codes, then the
    numbers as they are. Values are those of `LatentVectorEnv`, bit by bit.
    """

    def __init__(self, env: gymnasium.Env, encoder: FrameEncoder | str | Path | None = None) -> None:
        """Wrap an environment; `encoder` is an encoder or an argument of `load_compatible_encoder`.

        Raises `InteropError` for observations without an image, `EncoderInputError` for images that the encoder
        does not take, and the errors of `load_compatible_encoder`.
        """
        RecordConstructorArgs.__init__(self, encoder=encoder)
        gymnasium.ObservationWrapper.__init__(self, env)
        self._parts = ObservationParts(env.observation_space)
        if self._parts.image_shape is None:
            raise InteropError(
                f"an encoder needs images, the environment's observations are {env.observation_space}: choose"
                " observation='rgb+mask', or what the encoder takes"
            )
        if encoder is None or isinstance(encoder, str | Path):
            encoder = load_compatible_encoder(encoder)
        self.encoder = encoder
        self.encoder(np.zeros((1, *self._parts.image_shape), np.uint8))  # refuses other images now, not at a reset
        self.observation_space = vector_space(self.encoder.latent + self._parts.size)

    def observation(self, observation: Any) -> np.ndarray:
        """Return the code of an observation, followed by its numbers if it has any."""
        code = self.encoder(np.asarray(self._parts.image(observation))[None])[0]
        return joined([code, self._parts.numbers(observation)]) if self._parts.size else code
