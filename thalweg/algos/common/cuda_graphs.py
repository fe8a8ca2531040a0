"""CUDA graphs of gradient steps: a step is recorded once, then replayed as one call.

A recorded step reads and writes the memory it was recorded with, and every number that Python gave it stays as it was:
what it learns from is copied to one place, and it is recorded anew when such a number changes. Nothing in it may be
read by the host or come from there. Without a GPU, and where it is not asked for, steps are simply taken.
"""

from collections.abc import Callable, Hashable, Sequence

import torch
from torch import Tensor

Step = Callable[[Tensor], None]
WARM = 2
"""Steps of a kind that are taken as they are before one is recorded: libraries set themselves up in them."""


class CudaGraphs:
    """Steps of a few kinds, each recorded once."""

    def __init__(self, asked: bool, generators: Sequence[torch.Generator]) -> None:
        """`generators`: all that random numbers within steps come from."""
        self.asked, self._generators = asked, list(generators)
        self._numbers: Hashable = None
        self._taken: dict[Hashable, int] = {}
        self._replays: dict[Hashable, tuple[Tensor, Callable[[], None]]] = {}

    def run(self, step: Step, rows: Tensor, kind: Hashable, numbers: Hashable) -> None:
        """Take a step that learns from these rows.

        Args:
            step: What is to be done with rows of this shape; the same for every call.
            rows: What it learns from.
            kind: What it does is the same whenever this is.
            numbers: What Python gives it beside that.
        """
        if not self.asked:
            step(rows)
            return
        moved, self._numbers = numbers != self._numbers, numbers
        place = (kind, tuple(rows.shape))
        if moved:  # perhaps in every step: then nothing is worth recording
            self._replays.clear()
            beside(step, rows)
        elif place in self._replays:
            kept, replay = self._replays[place]
            kept.copy_(rows)
            replay()
        elif self._taken.get(place, 0) < WARM:
            self._taken[place] = self._taken.get(place, 0) + 1
            beside(step, rows)
        else:
            kept = rows.clone()
            self._replays[place] = kept, recorded(lambda: step(kept), self._generators)


def beside(step: Step, rows: Tensor) -> None:
    """Take a step on a stream of its own, as one that is to be recorded must be before."""
    stream = torch.cuda.Stream(rows.device)
    stream.wait_stream(torch.cuda.current_stream(rows.device))
    with torch.cuda.stream(stream):
        step(rows)
    torch.cuda.current_stream(rows.device).wait_stream(stream)


def recorded(step: Callable[[], None], generators: Sequence[torch.Generator]) -> Callable[[], None]:
    """Take a step, and give what takes it again."""
    graph = torch.cuda.CUDAGraph()
    for generator in generators:
        graph.register_generator_state(generator)  # pyright: ignore[reportAttributeAccessIssue]
    with torch.cuda.graph(graph):
        step()
    graph.replay()  # recording alone does nothing
    return graph.replay
