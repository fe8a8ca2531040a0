"""Progress bar of a run."""

import math
import time
from typing import Self

from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from thalweg.train.trainer import Trainer

INTERVAL_S = 0.2
"""Least time between two updates of the bar."""


class ProgressBar:
    """A progress bar with steps per second and the means of the last episodes; invisible unless `shown`."""

    def __init__(self, title: str, steps: int, shown: bool) -> None:
        words = "{task.completed:,.0f}/{task.total:,.0f} steps, {task.fields[rate]:,.0f}/s {task.fields[means]}"
        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TextColumn(words))
        self._bar = Bar(*columns, TimeRemainingColumn())
        self._bar.disable = not shown
        self._task = self._bar.add_task(title, total=steps, rate=0.0, means="")
        self._at, self._steps = time.perf_counter(), -1

    def show(self, trainer: Trainer) -> None:
        """Update the bar, at most a few times a second, and at the end of the run."""
        now, steps = time.perf_counter(), trainer.statistics.steps
        if self._bar.disable or (now - self._at < INTERVAL_S and not trainer.done):
            return
        # The rate is that of this call: steps before a resume do not count.
        rate = (steps - self._steps) / max(now - self._at, 1e-9) if self._steps >= 0 else math.nan
        means = trainer.statistics.metrics()
        text = f"return {means['return_mean_50']:.2f} cost {means['cost_mean_50']:.2f}"
        self._bar.update(self._task, completed=min(steps, trainer.steps), rate=rate, means=text)
        self._at, self._steps = now, steps

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()
