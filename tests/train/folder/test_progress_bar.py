"""Tests of what a run's progress bar says."""

from types import SimpleNamespace
from typing import Any

import pytest

from thalweg.train.folder import progress_bar
from thalweg.train.folder.progress_bar import ProgressBar

MEANS = {"return_mean_50": 1.5, "cost_mean_50": 0.25}


def trainer(steps: int) -> Any:
    return SimpleNamespace(
        steps=1000, done=steps >= 1000, statistics=SimpleNamespace(steps=steps, metrics=lambda: MEANS)
    )


def test_the_rate_is_the_mean_of_this_call_with_its_learning(monkeypatch: pytest.MonkeyPatch):
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(progress_bar.time, "perf_counter", lambda: clock.now)
    bar = ProgressBar("PPO", 1000, shown=True)
    rates = []
    # 400 steps were taken before a resume; one second of collecting 100 steps, nine of learning, and so on.
    for clock.now, steps in ((110.0, 400), (111.0, 500), (111.1, 500), (120.0, 500), (130.0, 800), (130.1, 1000)):
        bar.show(trainer(steps))
        (task,) = bar._bar.tasks
        rates.append(task.fields["rate"])
    assert rates == ["", "100/s ", "100/s ", "10/s ", "20/s ", "30/s "]
    assert (task.completed, task.fields["means"]) == (1000, "return 1.50 cost 0.25")


def test_an_update_is_told_once_it_is_long(monkeypatch: pytest.MonkeyPatch):
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(progress_bar.time, "perf_counter", lambda: clock.now)
    bar = ProgressBar("SafeLOOP", 1000, shown=True)
    (task,), told = bar._bar.tasks, []
    with bar.learning():
        for clock.now in (100.0, 101.9, 102.0, 115.4):
            told.append(bar._learning.render(task).plain)
    told.append(bar._learning.render(task).plain)
    assert told == ["", "", "learning for 2 s", "learning for 15 s", ""]
    assert bar._learning in bar._bar.columns
