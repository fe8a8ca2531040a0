"""The rules of the task: motion, progress, reward, cost, endings; a Gymnasium `Env` and `VectorEnv`."""

from thalweg.env.actions import ActionError
from thalweg.env.config import ConfigError, DoneReason, EnvConfig
from thalweg.env.making import make_single, make_vector
from thalweg.env.single import RiverEnv
from thalweg.env.starts import UnsafePoseError, sample_starts
from thalweg.env.state_arrays import StateError
from thalweg.env.vector import RiverVectorEnv

__all__ = [
    "ActionError",
    "ConfigError",
    "DoneReason",
    "EnvConfig",
    "RiverEnv",
    "RiverVectorEnv",
    "StateError",
    "UnsafePoseError",
    "make_single",
    "make_vector",
    "sample_starts",
]
