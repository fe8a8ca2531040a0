"""Numbers for critics beside the observation: the progress of an episode, and those of the ideal eye.

Critics exist in training only, so they may see what a policy must not know (asymmetric critics: Pinto et al.,
"Asymmetric Actor Critic for Image-Based Robot Learning", 2018). The progress decides what an episode can still pay and
when it ends; no frame shows it.
"""

from typing import Any

import gymnasium
import numpy as np

from thalweg.env.observation import parts_of
from thalweg.env.task.priced.eye import features_of

PROGRESS = ("visited", "idle", "steps")
"""Names of the numbers of the progress, shares in 0..1.

* visited: share of the course's segments that the episode has visited, or what else `info["progress"]` is.
* idle: consecutive steps without a new segment, per `EnvConfig.max_idle_steps`; the episode ends at 1.
* steps: steps of the episode, per its step limit (`thalweg.env.task.course_arrays.step_limit`); the episode ends at 1.
"""


def critic_features(observation: str | tuple[str, ...], task: str = "River", vehicle: str = "uav") -> tuple[str, ...]:
    """Return the names of the C numbers of `info["critic_obs"]`, in order; `observation`, `task` and `vehicle` as in
    `EnvConfig`.

    They are `PROGRESS`, then those of the ideal eye (`thalweg.env.task.priced.eye.features_of`, in metres and radians),
    unless the observation has these already.
    """
    return PROGRESS if "privileged" in parts_of(observation) else (*PROGRESS, *features_of(task, vehicle))


def critic_space(observation: str | tuple[str, ...], task: str = "River", vehicle: str = "uav") -> gymnasium.spaces.Box:
    """Return the space of the C numbers of one environment."""
    return gymnasium.spaces.Box(-np.inf, np.inf, (len(critic_features(observation, task, vehicle)),), np.float32)


def write_progress(out: Any, visited: Any, idle: Any, steps: Any) -> None:
    """Write the columns `PROGRESS` of out [M, C] float32.

    Each of the others is a pair of a count [M] and its limit, a number or [M]; all arrays, or all tensors. Counts of
    tensors are float64: the quotient of integers has PyTorch's default type.
    """
    for column, (count, limit) in enumerate((visited, idle, steps)):
        out[:, column] = count / limit
