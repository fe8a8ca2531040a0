"""Errors and warnings of the algorithms."""

import math


class AlgorithmError(ValueError):
    """An algorithm, setting, space or file that can't be used; says which are known or what was expected."""


class NotFiniteError(ArithmeticError):
    """A number that learning depends on has become NaN or infinite; says which one."""


class LimitWarning(UserWarning):
    """A cost limit or multiplier that can't do its work in this run."""


def require_finite(**numbers: float) -> None:
    """Raises `NotFiniteError` naming the first number that is NaN or infinite."""
    for name, number in numbers.items():
        if not math.isfinite(number):
            raise NotFiniteError(f"{name} has become {number}")
