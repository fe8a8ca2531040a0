"""Shape checks of the formulas, and numbers as tensors of a given type.

Every formula of several arrays checks their shapes first, because a broadcast gives a wrong result silently: `[B, 1]`
with `[B]` becomes a `[B, B]` matrix whose mean looks like a loss. This is how a published library lost the trust region
of FOCOPS.
"""

from collections.abc import Sequence

from torch import Tensor


def same_shape(**arrays: Tensor) -> None:
    """Raise `ValueError`, naming every array with its shape, unless all have the same shape."""
    shapes = {name: tuple(array.shape) for name, array in arrays.items()}
    if len(set(shapes.values())) > 1:
        raise ValueError(f"these arrays must have the same shape: {shapes}")


def rank(number: int, **arrays: Tensor) -> None:
    """Raise `ValueError` unless every array has `number` dimensions."""
    wrong = {name: tuple(array.shape) for name, array in arrays.items() if array.dim() != number}
    if wrong:
        raise ValueError(f"these arrays must have {number} dimensions: {wrong}")


def tensor_like(numbers: Sequence[float], like: Tensor) -> Tensor:
    """Return numbers [A] as a tensor of the type and on the device of another.

    On a GPU, numbers are filled in one by one, because a copy from the host would wait for the device.
    """
    if like.is_cpu:
        return like.new_tensor(numbers)
    result = like.new_empty(len(numbers))
    for index, number in enumerate(numbers):
        result[index].fill_(number)
    return result
