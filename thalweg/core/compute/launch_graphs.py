"""Launches on a GPU that repeat with the same arguments: recorded once as a CUDA graph, then replayed as one call.

Preparing the arguments of a kernel with many arrays takes the host a millisecond, a replay some microseconds. A replay
reads and writes the memory that was recorded, so whoever records keeps its inputs in tensors that stay where they are.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any

MOST = 8
"""Most series of launches that are remembered; the one unused for longest is forgotten first."""


class LaunchGraphs:
    """Series of launches on one device, each recorded when it is asked for again."""

    def __init__(self, device: Any) -> None:
        self._device = device
        self._replays: OrderedDict[Hashable, Callable[[], None] | None] = OrderedDict()
        """None for a series that ran once, unrecorded."""

    def run(self, key: Hashable, launches: Callable[[], None]) -> None:
        """Launch, by replay if recorded. Launches of the same key have the same arguments; they must not allocate
        memory or wait for the device when they run again.

        The first run is not recorded, since kernels are compiled and loaded in it. Neither is any while the caller
        records a graph of their own.
        """
        if _is_recording(self._device):
            launches()
            return
        replay = self._replays.get(key)
        if replay is not None:
            replay()
        elif key in self._replays:
            self._replays[key] = recorded(launches, self._device)
        else:
            launches()
            self._replays[key] = None
        self._replays.move_to_end(key)
        if len(self._replays) > MOST:
            self._replays.popitem(last=False)

    def clear(self) -> None:
        """Forget all recordings, because memory that they use moves."""
        self._replays.clear()


def recorded(launches: Callable[[], None], device: Any) -> Callable[[], None]:
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


def _is_recording(device: Any) -> bool:
    import torch

    return torch.device(device).type == "cuda" and torch.cuda.is_current_stream_capturing()
