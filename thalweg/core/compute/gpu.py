"""Kernels and arrays on a GPU, through numba-cuda and PyTorch; both are imported only when a GPU is used.

A kernel is written as a plain function, which `compile_kernel` compiles for a device. PyTorch allocates all arrays, so
that it and the kernels share one memory pool and one stream and nothing is copied between them.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np


@cache
def compile_kernel(function: Callable, fastmath: bool) -> Any:
    """Return a CUDA kernel of a function, compiled at its first launch; `fastmath` as in `jit.kernel`.

    A closure is compiled once for each function object. Numba's warnings about launches of fewer than 128 blocks are
    switched off for the process: few environments are intended.
    """
    from numba import config, cuda  # not before a GPU is used

    config.CUDA_LOW_OCCUPANCY_WARNINGS = 0
    return cuda.jit(function, fastmath=fastmath)


def launch(
    function: Callable,
    blocks: int | tuple[int, ...],
    threads: int,
    device: Any,
    *arguments: Any,
    fastmath: bool = True,
) -> None:
    """Launch a kernel on PyTorch's current stream of a device, without waiting for it."""
    import torch
    from numba import cuda

    stream = cuda.external_stream(torch.cuda.current_stream(device).cuda_stream)
    with cuda.gpus[torch.device(device).index or 0]:
        compile_kernel(function, fastmath)[blocks, threads, stream](*arguments)


def as_kernel_array(tensor: Any, dtype: Any = None) -> Any:
    """Return a tensor's memory as a kernel array without a copy, viewed as `dtype` (of the same size) if given."""
    from numba import cuda

    array = cuda.as_cuda_array(tensor, sync=False)
    return array if dtype is None else array.view(dtype)


def to_device(array: np.ndarray, device: Any) -> Any:
    """Return a copy of a host array as a kernel array on a device."""
    import torch

    # Copied as bytes, because PyTorch lacks some of NumPy's types, such as uint32.
    copied = torch.from_numpy(np.ascontiguousarray(array).view(np.uint8).reshape(-1).copy()).to(device)
    return as_kernel_array(copied, array.dtype).reshape(array.shape)


def empty(shape: tuple[int, ...], dtype: Any, device: Any) -> Any:
    """Return an uninitialised kernel array on a device."""
    import torch

    length = int(np.prod(shape)) * np.dtype(dtype).itemsize
    return as_kernel_array(torch.empty(length, dtype=torch.uint8, device=device), dtype).reshape(shape)


def zeros(shape: tuple[int, ...], dtype: Any, device: Any) -> Any:
    """Return a kernel array of zeros on a device."""
    import torch

    length = int(np.prod(shape)) * np.dtype(dtype).itemsize
    return as_kernel_array(torch.zeros(length, dtype=torch.uint8, device=device), dtype).reshape(shape)


def overwrite(array: Any, begin: int, rows: np.ndarray, device: Any) -> None:
    """Copy rows of the host into a kernel array, from its row `begin` on."""
    import torch

    if not rows.size:
        return
    part = array[begin : begin + len(rows)].reshape(-1)
    target = torch.as_tensor(part.view(np.uint8) if part.dtype.itemsize > 1 else part, device=device)
    target.copy_(torch.from_numpy(np.ascontiguousarray(rows).reshape(-1).view(np.uint8)))


def to_host(array: Any, device: Any) -> np.ndarray:
    """Return a copy of a kernel array on the host, after all earlier launches have finished."""
    import torch

    array_bytes = array.view(np.uint8) if array.dtype.itemsize > 1 else array
    return torch.as_tensor(array_bytes, device=device).cpu().numpy().view(array.dtype).reshape(array.shape)


def free_bytes(device: Any) -> int:
    """Return the device memory that is not in use; memory that PyTorch has reserved but not allocated is free."""
    import torch

    free, _ = torch.cuda.mem_get_info(device)
    return free + torch.cuda.memory_reserved(device) - torch.cuda.memory_allocated(device)
