"""How costs of episodes are distributed about a limit: share above it, and mean of the worst tenth.

A mean cost within its limit may hide episodes far above it; these figures show them.
"""

import numpy as np

TAIL = 0.9
"""Share of the episodes that the conditional value at risk leaves out, those of the least cost."""


def conditional_value_at_risk(costs: np.ndarray, level: float = TAIL) -> float:
    """Return the mean of the largest costs, a share 1 - level of all costs [K], which need not be a whole number.

    Source: Rockafellar and Uryasev 2002, "Conditional value-at-risk for general loss distributions", equation 18 for
    equally likely values. Raises `ValueError` for no costs, or a level outside 0..1 (1 excluded).
    """
    if not 0 <= level < 1:
        raise ValueError(f"level must be from 0 to below 1, not {level}")
    if not len(costs):
        raise ValueError("no costs")
    worst = np.sort(np.asarray(costs, np.float64))[::-1]
    share = (1.0 - level) * len(worst)
    # Weight 1 for each whole episode of the share, what is left of it for the next one, and 0 for the others.
    weights = np.clip(share - np.arange(len(worst)), 0.0, 1.0)
    return float((weights * worst).sum() / share)


def share_above(costs: np.ndarray, limit: float) -> float:
    """Return the share of the costs [K] that exceed a limit; raises `ValueError` for no costs."""
    if not len(costs):
        raise ValueError("no costs")
    return float(np.mean(np.asarray(costs) > limit))
