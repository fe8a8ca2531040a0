"""Launches on a GPU that repeat with the same arguments: recorded once as a CUDA graph, then replayed as one call.

Preparing the arguments of a kernel with many arrays takes the host a third of a millisecond, a replay of all kernels of
a frame some microseconds. A replay reads and writes the memory that was recorded, so inputs must stay in the same
tensors. `thalweg.algos.common.cuda_graphs` records gradient steps, which allocate memory and draw random numbers;
launches do neither.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any

MOST_GRAPHS = 8
"""Most series of launches that are remembered; the one unused for longest is forgotten first."""


class LaunchGraphs:
    """Series of launches on one GPU, each recorded when it is asked for again."""

    def __init__(self, device: Any) -> None:
        self._device = device
        self._replays: OrderedDict[Hashable, Callable[[], None] | None] = OrderedDict()
        """None for a series that ran once, unrecorded."""

    @property
    def caller_records(self) -> bool:
        """Whether the caller is recording a CUDA graph on this device."""
        return caller_records(self._device)

    def run(self, key: Hashable, launches: Callable[[], None]) -> None:
        """Run the launches, or replay them if they are recorded.

        Launches of the same key have the same arguments; from their second run on they must neither allocate memory
        nor wait for the device. The first run is not recorded, since kernels are compiled and loaded in it. Nothing is
        recorded while the caller records a graph.
        """
        if self.caller_records:
            launches()
            return
        replay = self._replays.get(key)
        if replay is not None:
            replay()
        elif key in self._replays:
            self._replays[key] = record_launches(launches, self._device)
        else:
            launches()
            self._replays[key] = None
        self._replays.move_to_end(key)
        if len(self._replays) > MOST_GRAPHS:
            self._replays.popitem(last=False)

    def clear(self) -> None:
        """Forget all recordings, because memory that they use moves."""
        self._replays.clear()


def record_launches(launches: Callable[[], None], device: Any) -> Callable[[], None]:
    """Record launches, run them, and return a function that replays them."""
    import torch

    graph, stream = torch.cuda.CUDAGraph(), torch.cuda.Stream(device)
    current = torch.cuda.current_stream(device)
    stream.wait_stream(current)
    with torch.cuda.stream(stream):
        # Not `torch.cuda.graph`, which waits for the device and empties PyTorch's cache of memory first.
        graph.capture_begin(capture_error_mode="thread_local")
        try:
            launches()
        finally:
            graph.capture_end()
    current.wait_stream(stream)
    graph.replay()  # recording alone does nothing
    return graph.replay


def caller_records(device: Any) -> bool:
    """Return whether a CUDA graph is being recorded on the current stream of a device."""
    import torch

    with torch.cuda.device(device):
        return torch.cuda.is_current_stream_capturing()
