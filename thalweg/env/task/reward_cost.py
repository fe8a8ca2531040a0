"""Reward and cost of a step: a reward for new segments, and one cost at the end of an episode, by its reason."""

from thalweg.core.compute.jit import kernel
from thalweg.env.config import DoneReason

COLLISION, OUT_OF_VOLUME_VERTICAL = int(DoneReason.COLLISION), int(DoneReason.OUT_OF_VOLUME_VERTICAL)
"""First and last reason with a tight cost."""
YAW_OVER_DEVIATION, MAX_STEP_REACHED = int(DoneReason.YAW_OVER_DEVIATION), int(DoneReason.MAX_STEP_REACHED)
"""First and last reason with a loose cost."""

FULL_COURSE_REWARD = 10.0
"""Return of an episode that visits every segment, under the reward scheme `paper`."""


@kernel(fastmath=False, allocates=False)
def step_reward(new, segments, limits):
    """Return the reward of a step that visited `new` of all `segments` for the first time."""
    if limits.pays_share != 0:
        return FULL_COURSE_REWARD * new / segments
    return 1.0 if new > 0 else 0.0


@kernel(fastmath=False, allocates=False)
def step_costs(reason, limits):
    """Return the (tight, loose) cost of a step with a code of `DoneReason`; at most one of them is not zero."""
    if COLLISION <= reason <= OUT_OF_VOLUME_VERTICAL:
        return limits.tight_cost, 0.0
    if YAW_OVER_DEVIATION <= reason <= MAX_STEP_REACHED:
        if reason == MAX_STEP_REACHED and limits.task.deadline != 0:
            return 0.0, 0.0
        return 0.0, limits.loose_cost
    return 0.0, 0.0
