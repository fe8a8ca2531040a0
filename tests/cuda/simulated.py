"""Runs kernels in Numba's CUDA simulator, in a process of its own: every kernel is then plain Python, and what runs is
the source itself, not the CPU's compiled form of it.

Such a process must have NUMBA_ENABLE_CUDASIM=1 and NUMBA_DISABLE_JIT=1. `thalweg.core.compute.gpu` is given arrays of
the host in place of a device's.
"""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numba import cuda

from thalweg.core.compute import gpu
from thalweg.render import renderer

FREE_BYTES, DEVICE = 1_000_000_000, "simulator"


def launch(function: Callable, blocks: Any, threads: int, device: Any, *arguments: Any, fastmath: bool = True) -> None:
    cuda.jit(function)[blocks, threads](*arguments)


def begin() -> None:
    """Let the simulator stand for a device."""
    assert numba.config.ENABLE_CUDASIM and numba.config.DISABLE_JIT  # pyright: ignore
    gpu.launch = launch
    gpu.to_device = lambda array, device: np.array(array)
    gpu.empty = lambda shape, kind, device: np.empty(shape, kind)
    gpu.to_host = lambda array, device: np.array(array)
    renderer.resolve_device = str
    gpu.free_bytes = lambda device: FREE_BYTES
