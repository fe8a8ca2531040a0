"""Runs kernels in Numba's CUDA simulator, in a process of its own: every kernel is then plain Python, and what runs is
the source itself, not the CPU's compiled form of it.

Such a process must have NUMBA_ENABLE_CUDASIM=1 and NUMBA_DISABLE_JIT=1. `thalweg.core.compute.gpu` is given arrays of
the host in place of a device's.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
from numba import cuda
from numba.cuda.simulator import kernel as simulator_kernel
from numba.cuda.simulator.kernelapi import swapped_cuda_module as swapped_in_one

from thalweg.core.compute import gpu
from thalweg.render import renderer

FREE_BYTES, DEVICE = 1_000_000_000, "simulator"


def launch(function: Callable, blocks: Any, threads: int, device: Any, *arguments: Any, fastmath: bool = True) -> None:
    cuda.jit(function)[blocks, threads](*arguments)


@contextmanager
def swapped_in_all(function: Callable, simulated: Any) -> Iterator[None]:
    """Replace `cuda` in the modules of the package while a kernel runs, which may call functions of any of them.

    Numba does so only in the module of the kernel, and in those of functions that it has compiled.
    """
    modules = [module for name, module in sys.modules.items() if name.startswith("thalweg.")]
    with ExitStack() as stack:
        stack.enter_context(swapped_in_one(function, simulated))
        for module in modules:
            stack.enter_context(swapped_in_one(SimpleNamespace(__globals__=vars(module)), simulated))
        yield


def begin() -> None:
    """Let the simulator stand for a device."""
    assert numba.config.ENABLE_CUDASIM and numba.config.DISABLE_JIT  # pyright: ignore
    simulator_kernel.swapped_cuda_module = swapped_in_all
    gpu.launch = launch
    gpu.to_device = lambda array, device: np.array(array)
    gpu.empty = lambda shape, kind, device: np.empty(shape, kind)
    gpu.to_host = lambda array, device: np.array(array)
    renderer.resolve_device = str
    gpu.free_bytes = lambda device: FREE_BYTES
