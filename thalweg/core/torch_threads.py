"""In how many threads does PyTorch compute? It must be told anew: where kernels run on OpenMP, Numba gives it its own
number."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch

AT_FIRST = torch.get_num_threads()
"""What PyTorch took by itself."""


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """PyTorch uses that many threads inside."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def asked_threads() -> int:
    """How many threads it was to have: `OMP_NUM_THREADS`, else as many as it took by itself."""
    asked = os.environ.get("OMP_NUM_THREADS", "")
    return int(asked) if asked.isdigit() and int(asked) > 0 else AT_FIRST
