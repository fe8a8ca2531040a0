"""CUDA graphs of gradient steps: a step is recorded once, then replayed as one call.

A recorded step reads and writes the memory it was recorded with, and numbers passed by Python are constants in it. Its
rows are therefore copied to a fixed buffer, and it is recorded again when such a number changes. It must not transfer
data between host and GPU. Without a GPU, or if graphs are not enabled, steps are called directly.
"""

from collections.abc import Callable, Hashable, Sequence

import torch
from torch import Tensor

Step = Callable[[Tensor], None]
WARM = 2
"""Number of steps of a kind that run unrecorded first, because libraries initialise themselves in them."""


class CudaGraphs:
    """Recorded gradient steps, one for each kind of step and shape of its rows."""

    def __init__(self, enabled: bool, generators: Sequence[torch.Generator]) -> None:
        """`enabled` switches recording on; `generators` are all sources of random numbers within steps."""
        self.enabled, self._generators = enabled, list(generators)
        self._numbers: Hashable = None
        self._taken: dict[Hashable, int] = {}
        self._replays: dict[Hashable, tuple[Tensor, Callable[[], None]]] = {}

    def run(self, step: Step, rows: Tensor, kind: Hashable, numbers: Hashable) -> None:
        """Take a gradient step on rows, by replay if it is recorded.

        Args:
            step: Function of the rows; its operations depend only on `kind`, `numbers` and the shape of the rows.
            rows: Data of the step.
            kind: Kind of the step.
            numbers: Python numbers that the step uses; a change of them discards all recordings.
        """
        if not self.enabled:
            step(rows)
            return
        moved, self._numbers = numbers != self._numbers, numbers
        key = (kind, tuple(rows.shape))
        if moved:  # it may change in every step, and recording then would only cost time
            self._replays.clear()
            beside(step, rows)
        elif key in self._replays:
            static_rows, replay = self._replays[key]
            static_rows.copy_(rows)
            replay()
        elif self._taken.get(key, 0) < WARM:
            self._taken[key] = self._taken.get(key, 0) + 1
            beside(step, rows)
        else:
            static_rows = rows.clone()
            self._replays[key] = static_rows, recorded(lambda: step(static_rows), self._generators)


def beside(step: Step, rows: Tensor) -> None:
    """Take a step on a separate stream, which CUDA requires before a step is recorded."""
    stream = torch.cuda.Stream(rows.device)
    stream.wait_stream(torch.cuda.current_stream(rows.device))
    with torch.cuda.stream(stream):
        step(rows)
    torch.cuda.current_stream(rows.device).wait_stream(stream)


def recorded(step: Callable[[], None], generators: Sequence[torch.Generator]) -> Callable[[], None]:
    """Record and take a step, and return a function that replays it."""
    graph = torch.cuda.CUDAGraph()
    for generator in generators:
        graph.register_generator_state(generator)  # pyright: ignore[reportAttributeAccessIssue]
    with torch.cuda.graph(graph):
        step()
    graph.replay()  # recording alone does nothing
    return graph.replay
