"""Thalweg: a photo-realistic river world and a benchmark of safe reinforcement learning on it.

Importing the package registers its Gymnasium ids and nothing else; its parts are imported when they are used.
"""

from gymnasium.envs.registration import register, registry

LEVEL_IDS = {name: f"thalweg/{name}-v0" for name in ("Easy", "Medium", "Hard")}
"""Gymnasium id of each level's fixed river."""


def register_envs() -> None:
    """Register the Gymnasium ids of the levels; a second call changes nothing."""
    for level, name in LEVEL_IDS.items():
        if name not in registry:
            register(
                id=name,
                entry_point="thalweg.env:make_single",
                vector_entry_point="thalweg.env:make_vector",
                kwargs={"level": level},
            )


register_envs()
