"""Vector environments of a Gymnasium id, whose observations are codes if an encoder is given, for all adapters."""

from pathlib import Path
from typing import Any

import gymnasium
from gymnasium.vector import VectorEnv


def vector_env(env_id: str, num_envs: int, encoder: str | Path | None, options: dict[str, Any]) -> VectorEnv:
    """Return N environments of an id; with an encoder, their observations are its codes float32 [N, Z].

    Raises the errors of `gymnasium.make_vec` for the id and of `load_compatible_encoder`.
    """
    if encoder is None:
        return gymnasium.make_vec(env_id, num_envs=num_envs, **options)
    from thalweg.train.latent import LatentVectorEnv
    from thalweg.train.river import load_compatible_encoder

    loaded = load_compatible_encoder(encoder)
    envs = gymnasium.make_vec(env_id, num_envs=num_envs, **options)
    try:
        return LatentVectorEnv(envs, loaded)
    except BaseException:
        envs.close()
        raise
