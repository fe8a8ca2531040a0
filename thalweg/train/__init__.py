"""Training: rollouts, the training loop, checkpoints and logs; the only package that joins environment, encoder and
algorithm."""

from thalweg.train.errors import ResumeWarning, ShortRunWarning, TrainingError, UnitWarning
from thalweg.train.latent import LatentTensorEnv, LatentVectorEnv
from thalweg.train.numbers import NumbersTensorEnv, NumbersVectorEnv
from thalweg.train.run import run
from thalweg.train.run_in_folder import RunResult, load_policy

__all__ = [
    "LatentTensorEnv",
    "LatentVectorEnv",
    "NumbersTensorEnv",
    "NumbersVectorEnv",
    "ResumeWarning",
    "RunResult",
    "ShortRunWarning",
    "TrainingError",
    "UnitWarning",
    "load_policy",
    "run",
]
