"""Records of runs that were interrupted and resumed: events, times and status."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.train.small_runs import Stop, StopsAt, rows_of, train
from thalweg.train import loop
from thalweg.train.loop import StageClock


def test_the_events_of_a_resumed_run_are_its_rows(tmp_path: Path):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    with pytest.raises(Stop):
        train(tmp_path, env=StopsAt(371), checkpoint_seconds=1e9)  # a checkpoint after the first update alone
    assert train(tmp_path).resumed_from == 128
    events = EventAccumulator(str(tmp_path / "tensorboard")).Reload().Scalars("return_mean_50")
    rows = rows_of(tmp_path, "metrics.csv")
    assert [event.step for event in events] == [int(row["steps"]) for row in rows]
    assert [event.value for event in events] == pytest.approx([float(row["return_mean_50"]) for row in rows])


def test_the_time_of_a_resumed_run_goes_on_from_its_checkpoint(tmp_path: Path):
    with pytest.raises(Stop):
        train(tmp_path, env=StopsAt(371))
    assert train(tmp_path).resumed_from == 1408
    seconds = [float(row["seconds"]) for row in rows_of(tmp_path, "metrics.csv")]
    assert seconds == sorted(seconds)


def test_a_lap_has_the_steps_and_stages_since_the_last_one(monkeypatch: pytest.MonkeyPatch):
    clock, trainer = SimpleNamespace(now=100.0), SimpleNamespace(seconds=50.0, stages={"env": 5.0})
    trainer.statistics = SimpleNamespace(steps=400)
    monkeypatch.setattr(loop.time, "perf_counter", lambda: clock.now)
    laps, found = StageClock(trainer), {}  # pyright: ignore[reportArgumentType]
    for clock.now, env, trainer.statistics.steps in ((110.0, 9.0, 500), (112.0, 10.5, 800)):
        trainer.stages = {"env": env}
        found = laps.lap()
    assert found == {"steps_per_second": 150.0, "time_env": 1.5, "time_other": 0.5, "seconds": 62.0}


def test_a_run_that_is_interrupted_says_so(tmp_path: Path):
    class Interrupted(StopsAt):
        def step(self, actions: Any) -> Any:
            try:
                return super().step(actions)
            except Stop:
                raise KeyboardInterrupt from None

    with pytest.raises(KeyboardInterrupt):
        train(tmp_path, env=Interrupted(200))
    status = json.loads((tmp_path / "status.json").read_text())
    assert (status["state"], status["checkpoint"]) == ("interrupted", 768) and "error" not in status
