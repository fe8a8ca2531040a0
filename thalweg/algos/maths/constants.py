"""How do numbers that Python knows get beside a tensor?"""

from collections.abc import Sequence

from torch import Tensor


def numbers_like(numbers: Sequence[float], like: Tensor) -> Tensor:
    """Numbers [A] in the type of a tensor and where it lies; nothing is copied to a GPU, which would have to wait."""
    if like.is_cpu:
        return like.new_tensor(numbers)
    made = like.new_empty(len(numbers))
    for place, number in enumerate(numbers):
        made[place].fill_(number)
    return made
