"""The `info` of a vector environment: of the last action, and of episodes that ended with it."""

from typing import Any

import numpy as np

from thalweg.env.episodes.episodes import Episodes
from thalweg.env.rivers.assignment import DrawnRivers
from thalweg.env.spaces import observation_at
from thalweg.env.task.progress_share import progress_of


def info_of(episodes: Episodes, mask: np.ndarray) -> dict[str, Any]:
    """Return the info of the last action, with Gymnasium's masks; mask [N] bool selects the environments that it is
    about."""
    state, outcome, config, rivers = episodes.state, episodes.outcome, episodes.config, episodes.rivers
    info = {
        "cost": outcome.costs.sum(axis=1),
        "costs": outcome.costs.copy(),
        "done_reason": outcome.reason.copy(),
        "progress": progress_of(config, rivers.courses, state),
        "pose": state.pose.copy(),
        **episodes.forces.info(),
    }
    if isinstance(rivers, DrawnRivers):
        info["river"] = rivers.river.copy()
    if config.critic_info:
        info["critic_obs"] = episodes.observer.critic_obs(rivers.courses, state)
    return info | {f"_{key}": mask.copy() for key in info}


def final_info_of(info: dict[str, Any], batch: Any, ended: np.ndarray) -> dict[str, Any]:
    """Return `final_obs`, `final_info` and their masks, as Gymnasium defines them.

    `info` is that of the last action; ended [N] bool; of `batch` the first N observations are the new ones, and those
    after them the last ones of the episodes that ended.
    """
    final_obs = np.full(len(ended), None, dtype=object)
    for index, row in enumerate(np.flatnonzero(ended)):
        final_obs[row] = observation_at(batch, len(ended) + index)
    final_info = {key: np.zeros_like(value) for key, value in info.items()}
    for key, value in info.items():
        final_info[key][ended] = value[ended]
    return {
        "final_obs": final_obs,
        "_final_obs": ended.copy(),
        "final_info": final_info,
        "_final_info": ended.copy(),
    }
