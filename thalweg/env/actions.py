"""What can be done? Both action spaces, the check of what comes in, and its one form for the kernels: shares of a
step."""

import gymnasium
import numpy as np

BRANCHES = ("vertical", "yaw", "longitudinal", "lateral")
"""0 up, 1 none, 2 down; 0 left, 1 none, 2 right; 0 forward, 1 none, 2 backward; 0 left, 1 none, 2 right."""


class ActionError(ValueError):
    """An action of the wrong shape or type, or out of range."""


def action_space(action: str) -> gymnasium.spaces.Space:
    """The space of one environment's actions: `multidiscrete` or `continuous`."""
    if action == "multidiscrete":
        return gymnasium.spaces.MultiDiscrete([3, 3, 3, 3])
    return gymnasium.spaces.Box(-1.0, 1.0, (4,), dtype=np.float32)


def row_of_one(action: object) -> np.ndarray:
    """The action [4] of a single environment as a batch [1, 4]; raises `ActionError` for another shape."""
    try:
        given = np.asarray(action)
    except ValueError:  # of rows of unlike length
        given = np.empty(0)
    if given.shape != (4,):
        found = repr(action) if given.size <= 8 else f"an array of shape {given.shape}"
        raise ActionError(f"an action is four numbers, one each for {', '.join(BRANCHES)}, not {found}")
    return given[None]


def units(action: str, actions: object, count: int) -> np.ndarray:
    """Actions [N, 4] as shares of a step [N, 4] float64: up, turn left, forward, left in -1..1; raises
    `ActionError`."""
    given = np.asarray(actions)
    if given.shape != (count, 4):
        raise ActionError(
            f"actions have shape {given.shape}; needed: ({count}, 4), one row of {', '.join(BRANCHES)} each"
        )
    if action == "multidiscrete":
        if not np.issubdtype(given.dtype, np.integer):
            raise ActionError(f"actions have type {given.dtype}; multidiscrete actions are integers 0, 1 or 2")
        low, high = 0, 2
    else:
        if not (np.issubdtype(given.dtype, np.floating) or np.issubdtype(given.dtype, np.integer)):
            raise ActionError(f"actions have type {given.dtype}; continuous actions are numbers in -1..1")
        low, high = -1, 1
    bad = ~((given >= low) & (given <= high))
    if bad.any():
        row, branch = (int(index) for index in np.argwhere(bad)[0])
        raise ActionError(
            f"action {given[row, branch]} of environment {row} ({BRANCHES[branch]}) is out of range {low}..{high}"
        )
    return 1.0 - given if action == "multidiscrete" else given.astype(np.float64)


def from_units(action: str, shares: np.ndarray) -> np.ndarray:
    """Shares of a step [N, 4], each -1, 0 or 1, as actions [N, 4] of the space."""
    return (1 - shares).astype(np.int64) if action == "multidiscrete" else shares.astype(np.float32)
