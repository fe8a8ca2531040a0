"""Errors and warnings of the algorithms."""

import math


class AlgorithmError(ValueError):
    """Error for an invalid algorithm, setting, space or file; the message names the known ones or what was expected."""


class NotFiniteError(ArithmeticError):
    """Error for a number that training depends on and that has become NaN or infinite; the message names it."""


class LimitWarning(UserWarning):
    """Warning about a cost limit that nobody is known to hold, or a limit or multiplier without effect in this run."""


def require_finite(**numbers: float) -> None:
    """Raise `NotFiniteError` naming the first number that is NaN or infinite."""
    for name, number in numbers.items():
        if not math.isfinite(number):
            raise NotFiniteError(f"{name} has become {number}")
