"""The moves of a vehicle that never flies backwards, as unit actions and as options."""

import itertools

import numpy as np

from thalweg.env.spaces import from_unit_actions

MOVES = np.array(list(itertools.product((0, 1, -1), (0, 1, -1), (1, 0), (0, 1, -1))), dtype=np.int64)
"""[M, 4] all moves, as unit actions: up, turn left, forward, left. There is no move backward, which has no effect in
the paper's task."""
MOVE_OPTIONS = from_unit_actions("multidiscrete", MOVES)
"""[M, 4] the options of each move in the branches of a multi-discrete action."""
