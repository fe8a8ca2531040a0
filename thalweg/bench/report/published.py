"""Published figures of the paper, which was measured in another simulator.

Wang and Mahmoudian, "Vision-driven UAV River Following: Benchmarking with Safe Reinforcement Learning",
IFAC-PapersOnLine 58-20 (2024), arXiv:2409.08511. The test table has mean and standard deviation over 60 episodes (20
for each of three seeds) after 200,000 training steps on the paper's own Medium river, which differs from ours.
"""

from dataclasses import dataclass

SOURCE = "Wang and Mahmoudian 2024, arXiv:2409.08511"


@dataclass(frozen=True)
class Published:
    """One cell of the paper's table."""

    return_mean: float
    return_std: float
    cost_mean: float
    cost_std: float


LEVELS = ("Easy", "Medium", "Hard")

_TABLE = {
    "PPO": ((9.19, 2.63, 0.09, 0.28), (5.22, 3.89, 0.74, 0.44), (1.34, 1.34, 0.84, 0.32)),
    "PPOLag": ((5.86, 3.85, 0.32, 0.38), (3.81, 3.36, 0.79, 0.37), (0.96, 0.87, 0.65, 0.40)),
    "FOCOPS": ((7.83, 3.74, 0.15, 0.32), (6.30, 4.41, 0.49, 0.49), (2.05, 1.96, 0.79, 0.35)),
    "P3O": ((6.23, 3.93, 0.37, 0.44), (3.14, 3.43, 0.67, 0.41), (0.85, 0.82, 0.65, 0.40)),
    "OnCRPO": ((0.27, 0.50, 0.27, 0.22), (0.10, 0.14, 0.29, 0.26), (0.15, 0.23, 0.36, 0.32)),
    "DDPGLag": ((1.75, 2.55, 0.78, 0.37), (0.73, 0.91, 0.83, 0.33), (0.44, 0.64, 0.80, 0.35)),
    "TD3Lag": ((0.14, 0.12, 0.55, 0.40), (0.13, 0.10, 0.69, 0.39), (0.10, 0.10, 0.48, 0.38)),
    "SACLag": ((0.06, 0.18, 0.20, 0.00), (0.02, 0.03, 0.27, 0.22), (0.04, 0.11, 0.27, 0.22)),
    "SafeLOOP": ((0.12, 0.12, 0.87, 0.30), (0.12, 0.11, 0.92, 0.24), (0.15, 0.24, 0.84, 0.32)),
    "CCEPETS": ((0.08, 0.10, 0.79, 0.35), (0.05, 0.04, 0.79, 0.35), (0.08, 0.23, 0.69, 0.39)),
}

PUBLISHED: dict[tuple[str, str], Published] = {
    (algorithm, level): Published(*cell)
    for algorithm, cells in _TABLE.items()
    for level, cell in zip(LEVELS, cells, strict=True)
}
"""The test table by algorithm and level."""

RELATIVE_ENTROPY = {
    ("rgb", "mask"): 0.103,
    ("rgb", "rgb+mask"): 0.037,
    ("mask", "rgb"): 0.075,
    ("mask", "rgb+mask"): 0.091,
    ("rgb+mask", "rgb"): 0.075,
    ("rgb+mask", "mask"): 0.187,
}
"""Relative entropy D(P ‖ Q) between the codes of encoders with different inputs, by (P, Q)."""
