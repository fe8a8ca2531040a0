"""Where environment, encoder and algorithm meet: rollouts, the training loop, checkpoints and loggers."""

from thalweg.train.errors import ResumeWarning, TrainingError
from thalweg.train.latent import LatentVectorEnv
from thalweg.train.run import RunResult, load_policy, run
from thalweg.train.tensors import LatentTensorEnv

__all__ = ["LatentTensorEnv", "LatentVectorEnv", "ResumeWarning", "RunResult", "TrainingError", "load_policy", "run"]
