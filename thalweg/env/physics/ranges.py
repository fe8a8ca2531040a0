"""A number that is fixed, or drawn in each episode from a range."""

from typing import Any

from pydantic import AfterValidator, BeforeValidator


def _pair(value: Any) -> Any:
    """Return a number as a range that holds nothing else, and anything else unchanged."""
    return (value, value) if isinstance(value, int | float) and not isinstance(value, bool) else value


def _in_order(value: tuple[float, float]) -> tuple[float, float]:
    """Return a range; raises `ValueError` if its upper end is first."""
    if value[0] > value[1]:
        raise ValueError(f"a range must have its lower end first, got {value}")
    return value


FromNumber, InOrder = BeforeValidator(_pair), AfterValidator(_in_order)
"""Annotations of a pair of numbers: one number becomes a pair, and the lower end is first."""
