"""Episodes and a suite whose statistics are known."""

from thalweg.bench.evaluate.conditions import Condition
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.suite.arms import Arm
from thalweg.bench.suite.config import Suite

SUITE = Suite(
    "it", (Arm("PPO"), Arm("FOCOPS"), Arm("P3O")), test_levels=("Medium",), baselines=("hover",), packaged=False,
    conditions=(Condition("mode", deterministic=True), Condition("real", rivers=("Cam",))),
)  # fmt: skip


def flights(name: str, seeds: int, return_: float, cost: float, level: str = "Medium") -> list[Episode]:
    """Two starts per seed: returns differ by 1 between seeds and by 2 between starts; the second start has a cost."""
    return [
        Episode(
            name, seed, level, 1, start, float(start), 0.0, 5.0, 0.0, return_ + seed + 2 * start, cost * start,
            cost * start, 0.0, 50, "Collision" if cost * start else "Success", not cost * start, 0.5,
            10.0 * start, 3.0, 5.0,
        )
        for seed in range(seeds)
        for start in range(2)
    ]  # fmt: skip
