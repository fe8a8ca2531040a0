"""How long did each stage take? Of a GPU, whose work goes on after the call that began it, by its own clock."""

import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch


class Stopwatch:
    """Seconds of named stages on a device, added up."""

    def __init__(self, device: torch.device, *stages: str) -> None:
        self._gpu = device if device.type == "cuda" else None
        self._seconds = dict.fromkeys(stages, 0.0)
        self._running: deque[tuple[str, Any, Any]] = deque()
        """Stage, and the events of a GPU between which it lies."""

    @contextmanager
    def on(self, stage: str) -> Iterator[None]:
        """What the body does, or has the GPU do, belongs to the stage."""
        if self._gpu is None:
            before = time.perf_counter()
            yield
            self._seconds[stage] += time.perf_counter() - before
            return
        begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
        begin.record(torch.cuda.current_stream(self._gpu))
        yield
        end.record(torch.cuda.current_stream(self._gpu))
        self._running.append((stage, begin, end))

    @property
    def seconds(self) -> dict[str, float]:
        """By stage; of a GPU those that are over, without waiting for it."""
        while self._running and self._running[0][2].query():
            stage, begin, end = self._running.popleft()
            self._seconds[stage] += begin.elapsed_time(end) / 1000.0
        return dict(self._seconds)
