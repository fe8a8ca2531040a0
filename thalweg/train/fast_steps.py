"""Fast steps in policies of another task: at the beginning of a training, and in flights.

In a task with a fast step the third option of the branch forward is one; elsewhere it is dead, or backward. A policy
that was trained without fast steps hardly ever takes that option, or takes it to stay; neither says anything about fast
steps.
"""

from typing import Any

from thalweg.algos.policy.policy import OptionCopy, Policy
from thalweg.env.spaces import FORWARD
from thalweg.env.tasks import PAPER_TASK, task_named
from thalweg.train.errors import TrainingError
from thalweg.train.observations import action_of, task_of

FAST_SHARE = 0.1
"""Share of the moves forward that are fast at first."""
FORWARD_OPTION, FAST_OPTION = 0, 2
"""Options of the branch forward."""


def _have_fast_steps(policy: Any, task: str) -> tuple[bool, bool]:
    """Return whether the task that a policy was trained on has fast steps, and whether a `task` has them.

    Raises `TrainingError` if either is not known here.
    """
    try:
        has, needs = (task_named(name).fast_step_m > 0.0 for name in (task_of(policy), task))
    except ValueError as error:
        raise TrainingError(f"the policy was trained on {task_of(policy)} and is to fly {task}: {error}") from error
    return has, needs


def fast_step_of(policy: Any, task: str) -> OptionCopy | None:
    """Return which option of a policy of another task becomes the fast step of a `task`: it takes the weights of
    forward, and `FAST_SHARE` of the moves forward. None if both tasks have a fast step, or neither has.

    Raises `TrainingError` for a policy with fast steps in a task without them, for one whose actions are no options
    but numbers, of which other ones are fast steps, and for one of a task that is not known here.
    """
    trained_on = task_of(policy)
    has, needs = _have_fast_steps(policy, task)
    if has and not needs:
        raise TrainingError(
            f"the policy to begin with was trained on {trained_on}, which has fast steps, and {task} has none; begin"
            f" with a policy of {PAPER_TASK} or of another task without them"
        )
    if has or not needs:
        return None
    if isinstance(policy, Policy) and policy.actions.kind != "categorical":
        raise TrainingError(
            f"the policy to begin with was trained on {trained_on}, which has no fast step, and its actions are"
            f" numbers: in {task} the same numbers are other moves; begin with a policy of options"
        )
    return OptionCopy(FORWARD, FAST_OPTION, FORWARD_OPTION, (1.0 - FAST_SHARE) / FAST_SHARE)


def fast_step_in_words(policy: Any, task: str) -> str:
    """Return what `fast_step_of` makes of a policy, as a sentence."""
    return (
        f"the policy to begin with was trained on {task_of(policy)}, which has no fast step: in {task},"
        f" {FAST_SHARE:.0%} of its moves forward are fast at first"
    )


def other_steps_in_words(policy: Any, task: str) -> str:
    """Return what becomes of the moves forward of a trained policy in a `task`, if only one of both tasks has a fast
    step, as a sentence; else empty, and also if either task is not known here."""
    try:
        has, needs = _have_fast_steps(policy, task)
    except TrainingError:
        return ""
    if has == needs:
        return ""
    numbers = action_of(policy) == "continuous"
    if has:
        becomes = "its moves forward are shorter" if numbers else "where it would take one, it does not move forward"
        return f"the policy was trained on {task_of(policy)}, which has fast steps; {task} has none: {becomes}"
    becomes = "its moves forward are longer" if numbers else "its third option forward is one"
    return f"the policy was trained on {task_of(policy)}, which has no fast step; in {task} {becomes}"
