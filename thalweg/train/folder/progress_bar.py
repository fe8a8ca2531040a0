"""Progress bar of a run."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, Self

from rich.console import Console
from rich.progress import BarColumn, ProgressColumn, Task, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.text import Text

from thalweg.train.rollouts.episodes import COST_MEAN, RETURN_MEAN, EpisodeStatistics

INTERVAL_S = 0.2
"""Least time between two updates of the bar."""
LONG_S = 2.0
"""Duration from which an update is told: planners learn for seconds without a step."""


class Shown(Protocol):
    """What the bar shows of a trainer."""

    steps: int

    @property
    def statistics(self) -> EpisodeStatistics: ...
    @property
    def done(self) -> bool: ...


class LearningColumn(ProgressColumn):
    """Column that says how long the current update has taken, once that is `LONG_S`."""

    since: float | None = None
    """Time at which the update began; None between updates."""

    def render(self, task: Task) -> Text:
        """Return the text of the column, empty between updates."""
        seconds = 0.0 if self.since is None else time.perf_counter() - self.since
        return Text(f"learning for {seconds:.0f} s" if seconds >= LONG_S else "")


class ProgressBar:
    """A progress bar on stderr with steps per second, the means of the last episodes, and the time of a long update;
    invisible unless `shown`.

    The rate is the mean since the first update of the bar, learning included; steps before a resume do not count.
    """

    def __init__(self, title: str, steps: int, shown: bool) -> None:
        words = "{task.completed:,.0f}/{task.total:,.0f} steps, {task.fields[rate]}{task.fields[means]}"
        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TextColumn(words))
        self._learning = LearningColumn()
        self._bar = Bar(*columns, self._learning, TimeRemainingColumn(), console=Console(stderr=True))
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
        text = f"return {means[RETURN_MEAN]:.2f} cost {means[COST_MEAN]:.2f}"
        self._bar.update(self._task, completed=min(steps, trainer.steps), rate=rate, means=text)
        self._shown_at = now

    @contextmanager
    def learning(self) -> Iterator[None]:
        """Say that the learner updates, while the block runs."""
        self._learning.since = time.perf_counter()
        try:
            yield
        finally:
            self._learning.since = None

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()
