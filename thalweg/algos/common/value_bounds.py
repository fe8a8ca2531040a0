"""The check of given bounds of returns, and warnings about critics whose mean value is outside its bounds."""

from collections.abc import Sequence

ROUNDING = 1e-3
"""Share of a bound by which a mean value may exceed it before a warning is given."""


def check_return_bounds(bounds: Sequence[float]) -> None:
    """Raise `ValueError` unless bounds of returns are two, the smaller one first, or none."""
    if bounds and (len(bounds) != 2 or bounds[0] >= bounds[1]):
        raise ValueError(f"return_bounds must be two, the smaller one first, got {list(bounds)}")


def impossible_values(
    names: Sequence[str], means: Sequence[float], low: Sequence[float], high: Sequence[float], remedy: str
) -> dict[str, str]:
    """Return a warning, by a short code, for each mean value outside its bounds; none for equal bounds.

    Args:
        names: Name of each value: "reward", or a kind of cost.
        means: Mean values, in the task's units.
        low: The smallest possible values.
        high: The largest possible values.
        remedy: What to change, which ends the sentence.
    """
    found: dict[str, str] = {}
    for name, mean, least, most in zip(names, means, low, high, strict=True):
        pays = "pay" if name == "reward" else "cost"
        if least == most:  # nothing has been paid yet: an untrained critic is no news
            continue
        if mean > most + ROUNDING * abs(most):
            sentence = f"more than the {most:.4g} that an episode can {pays}"
        elif mean < least - ROUNDING * abs(least):
            sentence = f"less than the {least:.4g} that an episode must {pays}"
        else:
            continue
        found[f"impossible_value_of_{name.replace(' ', '_')}"] = (
            f"the critics' mean value of the {name} is {mean:.4g}, {sentence}: {remedy}"
        )
    return found
