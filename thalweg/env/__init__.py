"""The river task as a constrained Markov decision process: a Gymnasium `Env` and `VectorEnv`."""

from thalweg.env.config import ConfigError, DoneReason, EnvConfig, UnknownOptionError
from thalweg.env.env import RiverEnv
from thalweg.env.factory import make_single, make_vector
from thalweg.env.initial_poses import UnsafePoseError, sample_starts
from thalweg.env.snapshot import StateError
from thalweg.env.spaces import ActionError
from thalweg.env.tasks import TaskPlugin
from thalweg.env.vector_env import RiverVectorEnv

__all__ = [
    "ActionError",
    "ConfigError",
    "DoneReason",
    "EnvConfig",
    "RiverEnv",
    "RiverVectorEnv",
    "StateError",
    "TaskPlugin",
    "UnknownOptionError",
    "UnsafePoseError",
    "make_single",
    "make_vector",
    "sample_starts",
]
