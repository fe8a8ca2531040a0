"""Progress bar of a run."""

import time
from typing import Protocol, Self

from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from thalweg.train.rollouts.episodes import EpisodeStatistics

INTERVAL_S = 0.2
"""Least time between two updates of the bar."""


class Shown(Protocol):
    """What the bar shows of a trainer."""

    steps: int

    @property
    def statistics(self) -> EpisodeStatistics: ...
    @property
    def done(self) -> bool: ...


class ProgressBar:
    """A progress bar on stderr with steps per second and the means of the last episodes; invisible unless `shown`.

    The rate is the mean since the first update of the bar, learning included; steps before a resume do not count.
    """

    def __init__(self, title: str, steps: int, shown: bool) -> None:
        words = "{task.completed:,.0f}/{task.total:,.0f} steps, {task.fields[rate]}{task.fields[means]}"
        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TextColumn(words))
        self._bar = Bar(*columns, TimeRemainingColumn(), console=Console(stderr=True))
        self._bar.disable = not shown
        self._task = self._bar.add_task(title, total=steps, rate="", means="")
        self._shown_at, self._began_at, self._first_steps = 0.0, 0.0, -1

    def show(self, trainer: Shown) -> None:
        """Update the bar, at most a few times a second, and at the end of the run."""
        now, steps = time.perf_counter(), trainer.statistics.steps
        if self._bar.disable or (now - self._shown_at < INTERVAL_S and not trainer.done):
            return
        if self._first_steps < 0:
            self._began_at, self._first_steps = now, steps
        done = steps - self._first_steps
        rate = f"{done / (now - self._began_at):,.0f}/s " if done else ""
        means = trainer.statistics.metrics()
        text = f"return {means['return_mean_50']:.2f} cost {means['cost_mean_50']:.2f}"
        self._bar.update(self._task, completed=min(steps, trainer.steps), rate=rate, means=text)
        self._shown_at = now

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()
