"""The learning algorithms, one file each from config to update, on the shared formulas of `maths`."""

from thalweg.algos.common.errors import AlgorithmError, LimitWarning, NotFiniteError
from thalweg.algos.policy.policy import Policy
from thalweg.algos.policy.policy_file import About
from thalweg.algos.registry import ALGORITHMS, AlgorithmPlugin, Entry, algorithm_named

__all__ = [
    "ALGORITHMS",
    "About",
    "AlgorithmError",
    "AlgorithmPlugin",
    "Entry",
    "LimitWarning",
    "NotFiniteError",
    "Policy",
    "algorithm_named",
]
