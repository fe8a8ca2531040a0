"""Timer for the stages of a training step, on the clock of the device that computes them."""

import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch


class StageTimer:
    """Total seconds of named stages on a device.

    A GPU works asynchronously, so that its stages are timed by CUDA events instead of the host's clock.
    """

    def __init__(self, device: torch.device, *stages: str) -> None:
        self._gpu = device if device.type == "cuda" else None
        self._seconds = dict.fromkeys(stages, 0.0)
        self._pending: deque[tuple[str, Any, Any]] = deque()
        """Stage, first and last event of each measurement on a GPU that may not have finished."""

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Add the time of the body, or of what it launches on the GPU, to a stage."""
        if self._gpu is None:
            before = time.perf_counter()
            yield
            self._seconds[stage] += time.perf_counter() - before
            return
        begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
        begin.record(torch.cuda.current_stream(self._gpu))
        yield
        end.record(torch.cuda.current_stream(self._gpu))
        self._pending.append((stage, begin, end))

    @property
    def seconds(self) -> dict[str, float]:
        """Total seconds by stage; on a GPU those of finished measurements, without waiting for the others."""
        while self._pending and self._pending[0][2].query():
            stage, begin, end = self._pending.popleft()
            self._seconds[stage] += begin.elapsed_time(end) / 1000.0
        return dict(self._seconds)
