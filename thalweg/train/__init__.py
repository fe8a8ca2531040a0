"""Where environment, encoder and algorithm meet: rollouts, the training loop, checkpoints and loggers."""

from thalweg.train.errors import ResumeWarning, TrainingError
from thalweg.train.latent import LatentVectorEnv
from thalweg.train.rollouts.torch_collector import LatentTensorEnv
from thalweg.train.run import RunResult, load_policy, run

__all__ = ["LatentTensorEnv", "LatentVectorEnv", "ResumeWarning", "RunResult", "TrainingError", "load_policy", "run"]
