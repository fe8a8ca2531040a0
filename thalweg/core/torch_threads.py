"""The number of threads that PyTorch computes with.

It is set explicitly, because last bits depend on it and other libraries on OpenMP change it.
This is apart from `thalweg.core.threads` so that rendering on the CPU does not import PyTorch.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch

INITIAL_THREADS = torch.get_num_threads()
"""The number PyTorch chose on import."""


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Set PyTorch's number of threads to `count` inside the block."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def default_torch_threads() -> int:
    """Return `OMP_NUM_THREADS` if it is set to a positive number, else the number PyTorch chose on import."""
    value = os.environ.get("OMP_NUM_THREADS", "")
    return int(value) if value.isdigit() and int(value) > 0 else INITIAL_THREADS
