"""How does Thalweg reach a GPU? Through numba-cuda and torch, neither of which is imported before one is asked for.

A kernel is written as a plain function; `compiled` makes it run on a device. Arrays are made by torch, so that torch
and the kernels share one pool of memory and one stream, and nothing is copied from one to the other.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np


@cache
def compiled(function: Callable, fastmath: bool) -> Any:
    """The function as a kernel, compiled at its first launch; `fastmath` as for the kernels of the CPU.

    A function that was made by another is compiled once for each that the other made.
    """
    from numba import cuda  # not before a GPU is asked for

    return cuda.jit(function, fastmath=fastmath)


def launch(
    function: Callable,
    blocks: int | tuple[int, ...],
    threads: int,
    device: Any,
    *arguments: Any,
    fastmath: bool = True,
) -> None:
    """Start a kernel on torch's stream of a device, and return at once."""
    import torch
    from numba import cuda

    stream = cuda.external_stream(torch.cuda.current_stream(device).cuda_stream)
    with cuda.gpus[torch.device(device).index or 0]:
        compiled(function, fastmath)[blocks, threads, stream](*arguments)


def as_array(tensor: Any, dtype: Any = None) -> Any:
    """The kernels' view of a tensor's memory, as another type of the same size if `dtype` is given; no copy."""
    from numba import cuda

    array = cuda.as_cuda_array(tensor, sync=False)
    return array if dtype is None else array.view(dtype)


def on_device(array: np.ndarray, device: Any) -> Any:
    """A copy of a host's array on a device, in torch's memory, as the kernels see it."""
    import torch

    copied = torch.from_numpy(np.ascontiguousarray(array).view(np.uint8).reshape(-1).copy()).to(device)
    return as_array(copied, array.dtype).reshape(array.shape)


def empty(shape: tuple[int, ...], kind: Any, device: Any) -> Any:
    """Memory of torch's on a device, as the kernels see it."""
    import torch

    length = int(np.prod(shape)) * np.dtype(kind).itemsize
    return as_array(torch.empty(length, dtype=torch.uint8, device=device), kind).reshape(shape)


def to_host(array: Any, device: Any) -> np.ndarray:
    """A copy on the host of the kernels' array on a device, once all that was launched before is done."""
    import torch

    array_bytes = array.view(np.uint8) if array.dtype.itemsize > 1 else array
    return torch.as_tensor(array_bytes, device=device).cpu().numpy().view(array.dtype).reshape(array.shape)


def free_bytes(device: Any) -> int:
    """Memory of the device that is not in use, torch's own reserve counted as free."""
    import torch

    free, _ = torch.cuda.mem_get_info(device)
    return free + torch.cuda.memory_reserved(device) - torch.cuda.memory_allocated(device)
