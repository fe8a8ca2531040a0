"""Results whose statistics are known."""

from pathlib import Path

import numpy as np
import pytest

from tests.bench.report.small_results import SUITE, flights
from thalweg.bench.results.results import Results, RunRow
from thalweg.bench.results.statistics import TrainingLog


@pytest.fixture
def results() -> Results:
    """A baseline, two policies of three seeds, and a third policy that failed."""
    episodes = [*flights("hover", 1, 0.0, 0.4), *flights("PPO", 3, 4.0, 1.0), *flights("FOCOPS", 3, 5.5, 0.0)]
    runs = [RunRow(f"{name}-{seed}", "train", name, seed, 1000, "finished", "", 120.0 + 60 * seed, 9.0 - seed)
            for name in ("PPO", "FOCOPS") for seed in range(3)]  # fmt: skip
    runs.insert(0, RunRow("hover-0", "baseline", "hover", 0, 0, "finished"))
    runs.append(RunRow("P3O-0", "train", "P3O", 0, 10, "failed", "no"))
    logs = [TrainingLog("PPO", 0, np.arange(10), np.zeros(10), np.full(10, 0.5), np.zeros(10), 1000)]
    by_condition = {"mode": flights("PPO", 3, 4.5, 0.0), "real": flights("FOCOPS", 3, 1.0, 0.0, "Cam")}
    return Results(Path(), SUITE.as_data(), runs, episodes, logs, [], condition_episodes=by_condition)
