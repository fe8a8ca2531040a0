"""What is paid and charged? Reward for new segments; one cost at the end of an episode, by its reason."""

from thalweg.kernel import kernel

WHOLE_COURSE = 10.0
"""Reward of visiting every segment under the scheme `paper`."""


@kernel(fastmath=False)
def reward(new, segments, limits):
    """Reward of a step that visited `new` of all `segments` for the first time."""
    if limits.pays_share != 0:
        return WHOLE_COURSE * new / segments
    return 1.0 if new > 0 else 0.0


@kernel(fastmath=False)
def costs(reason, limits):
    """(tight, loose) cost of a step that ended for `reason`, a code of `DoneReason`; at most one of them is not
    zero."""
    if 0 <= reason <= 2:
        return limits.tight_cost, 0.0
    if 3 <= reason <= 5:
        return 0.0, limits.loose_cost
    return 0.0, 0.0
