"""Winds from fields of any type, as users who check no types give them: one number for a range, a list for a pair."""

from typing import Any

from thalweg.env.physics.wind import Wind


def wind_of(**fields: Any) -> Wind:
    """The wind with these fields."""
    return Wind(**fields)
