"""The switch between the definition of a gradient, torch's autograd, and the fast path that computes the same.

The definition is the loss as it stands in an algorithm's file, on a network of plain torch operations
(`StackedMLP.reference`), differentiated by `loss.backward()`. The fast path replaces it in four places, each of which
asks `enabled`: gradients of a `StackedMLP` are written out (`mlp_autograd`) or compiled (`mlp_numba`), those of a
distribution are written out (`TapedDistribution`), and a pass of the critics is one compiled call
(`Critics.fit_epoch`). `tests/algos/policy/test_fast_path.py` holds the two equal for every on-policy algorithm. A
fifth place is acting: options of a small categorical network are drawn by one compiled call (`option_sampling`, which
`tests/algos/policy/test_option_sampling.py` holds to the definition).

The fast path is on unless the environment variable `THALWEG_FAST_PATH` is 0. Results of the two agree within rounding,
not to the last bit.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from thalweg.algos.common.errors import AlgorithmError

VARIABLE = "THALWEG_FAST_PATH"


def _from_environment() -> bool:
    """Return the setting of the environment variable; raise `AlgorithmError` for anything but 0 and 1."""
    value = os.environ.get(VARIABLE, "1")
    if value not in ("0", "1"):
        raise AlgorithmError(f"{VARIABLE} must be 0 or 1, got {value!r}")
    return value == "1"


_on = _from_environment()


def enabled() -> bool:
    """Return whether gradients are computed by the fast path instead of by autograd."""
    return _on


@contextmanager
def switched(on: bool) -> Iterator[None]:
    """Switch the fast path on or off within a block, for all threads."""
    global _on
    before, _on = _on, on
    try:
        yield
    finally:
        _on = before
