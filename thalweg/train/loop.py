"""Training loop: steps, updates, log rows, checkpoints and status of one run."""

import time
from pathlib import Path
from typing import Any, Protocol, Self

from thalweg.train.folder import run_record
from thalweg.train.folder.checkpoint import newest_step, save_checkpoint
from thalweg.train.folder.loggers import RunLog
from thalweg.train.folder.progress_bar import ProgressBar
from thalweg.train.rollouts.episodes import COST_MEAN, RETURN_MEAN, Episode, EpisodeStatistics

CHECKPOINT_SHARE = 20
"""Least time between two checkpoints, in multiples of the time to write one, which is long for a large replay."""


class AnyTrainer(Protocol):
    """What the loop needs of a trainer: see `thalweg.train.trainer.Trainer`."""

    steps: int
    seed: int
    updates: int
    seconds: float
    warned: dict[str, str]

    @property
    def statistics(self) -> EpisodeStatistics: ...
    @property
    def policy(self) -> Any: ...
    @property
    def stages(self) -> dict[str, float]: ...
    @property
    def done(self) -> bool: ...
    @property
    def ready(self) -> bool: ...
    def start(self, state: dict[str, Any] | None = None) -> None: ...
    def step(self) -> list[Episode]: ...
    def update(self) -> dict[str, float]: ...
    def state(self) -> dict[str, Any]: ...


class StatusFile:
    """Writes the status.json of a run."""

    def __init__(self, folder: Path, algorithm: str, trainer: AnyTrainer) -> None:
        self.folder, self.algorithm, self.trainer = folder, algorithm, trainer

    def write(self, state: str, error: BaseException | None = None) -> dict[str, Any]:
        """Write the status of the run with a state, see `run_record.write_status`; returns it."""
        trainer, metrics = self.trainer, self.trainer.statistics.metrics()
        status = {
            "state": state,
            "algorithm": self.algorithm,
            "steps": trainer.statistics.steps,
            "checkpoint": newest_step(self.folder),
            "episodes": trainer.statistics.count,
            "return_mean": metrics[RETURN_MEAN],
            "cost_mean": metrics[COST_MEAN],
            "cost_rate": metrics["cost_rate"],
            "seconds": trainer.seconds,
            "warnings": trainer.warned,
        }
        if error is not None:
            status["error"] = f"{type(error).__name__}: {error}"
        run_record.write_status(self.folder, status)
        return status


class StageClock:
    """Measures how the time between two updates is spent; the run's own is counted also when it is interrupted."""

    def __init__(self, trainer: AnyTrainer) -> None:
        self.trainer = trainer
        self._time, self._steps = time.perf_counter(), trainer.statistics.steps
        self._counted = self._time
        self._stages = dict(trainer.stages)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.count()

    def count(self) -> float:
        """Add the time since the last call to that of the run; returns the clock's time in seconds."""
        now = time.perf_counter()
        self.trainer.seconds += now - self._counted
        self._counted = now
        return now

    def lap(self) -> dict[str, float]:
        """Return steps per second and seconds of each stage since the last lap.

        `time_other` is for files, bookkeeping and checkpoints. The time is counted.
        """
        now, stages = self.count(), dict(self.trainer.stages)
        wall, steps = now - self._time, self.trainer.statistics.steps - self._steps
        spent = {f"time_{name}": stages[name] - self._stages[name] for name in stages}
        self._time, self._steps, self._stages = now, self.trainer.statistics.steps, stages
        other = wall - sum(spent.values())
        return {"steps_per_second": steps / wall, **spent, "time_other": other, "seconds": self.trainer.seconds}


def training_loop(
    trainer: AnyTrainer,
    log: RunLog,
    bar: ProgressBar,
    status: StatusFile,
    identity: dict[str, Any],
    checkpoint_seconds: float,
) -> None:
    """Step and update until all steps are taken; checkpoints are written between updates only.

    `identity` says which run a checkpoint belongs to; `checkpoint_seconds` is the least time between two of them.
    """
    saved_at, pause = float("-inf"), checkpoint_seconds
    with StageClock(trainer) as clock:
        while not trainer.done:
            for episode in trainer.step():
                log.episode(episode)
            bar.show(trainer)
            if not trainer.ready:
                continue
            _update(trainer, log, bar, clock)
            before = clock.count()
            if trainer.done or before - saved_at >= pause:
                state = trainer.state() | {"identity": identity, "bytes": log.sync()}
                save_checkpoint(status.folder, trainer.statistics.steps, state)
                status.write("running")
                saved_at = time.perf_counter()
                pause = max(checkpoint_seconds, CHECKPOINT_SHARE * (saved_at - before)) if checkpoint_seconds else 0.0


def _update(trainer: AnyTrainer, log: RunLog, bar: ProgressBar, clock: StageClock) -> None:
    """Take an update, and log a row if it has metrics."""
    with bar.learning():
        metrics = trainer.update()
    statistics = trainer.statistics
    if metrics:
        row = {"steps": statistics.steps, "update": trainer.updates} | statistics.metrics() | metrics
        log.update(statistics.steps, row | clock.lap())
