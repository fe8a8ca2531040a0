"""The mean cost of the worst tenth of episodes, which a mean cost within its limit may hide."""

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
