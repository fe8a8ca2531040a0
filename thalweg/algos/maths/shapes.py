"""Do the arrays of a formula fit together? Formulas of several arrays ask first: a broadcast is a silent wrong answer.

A `[B, 1]` against a `[B]` becomes a `[B, B]` matrix whose mean looks like a loss: it cost a published library its
FOCOPS trust region.
"""

from torch import Tensor


def same_shape(**arrays: Tensor) -> None:
    """Raises `ValueError`, naming every array with its shape, unless all have the same shape."""
    shapes = {name: tuple(array.shape) for name, array in arrays.items()}
    if len(set(shapes.values())) > 1:
        raise ValueError(f"these arrays must have the same shape: {shapes}")


def rank(number: int, **arrays: Tensor) -> None:
    """Raises `ValueError` unless every array has `number` dimensions."""
    wrong = {name: tuple(array.shape) for name, array in arrays.items() if array.dim() != number}
    if wrong:
        raise ValueError(f"these arrays must have {number} dimensions: {wrong}")
