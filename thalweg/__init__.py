"""Thalweg: a photo-realistic river world and a benchmark of safe reinforcement learning on it.

Importing the package registers its Gymnasium ids; subpackages are imported when they are used.
"""

from typing import TYPE_CHECKING, Any

from gymnasium.envs.registration import register, registry

if TYPE_CHECKING:
    from thalweg.env.torch_env import TensorRiverEnv

    __version__: str
    """Version of the installed package, or "unknown" if it is run from its folder."""

LEVEL_IDS = {name: f"thalweg/{name}-v0" for name in ("Easy", "Medium", "Hard")}
"""Gymnasium id of each level's fixed river, in the paper's task."""
TASK_IDS = {
    (task, level): f"thalweg/{task}-{level}-v0"
    for task in ("Swimmers", "Nests", "RacingLine", "Portage")
    for level in LEVEL_IDS
}
"""Gymnasium id of each other task (`thalweg.env.tasks`) on each level's fixed river."""
BOAT_IDS = {"Easy": "thalweg/Easy-ASV-v0", "Medium-Deep": "thalweg/Medium-ASV-v0", "Hard-Deep": "thalweg/Hard-ASV-v0"}
"""Gymnasium id of the boat (`EnvConfig.vehicle = "asv"`) on the fixed river of each level with water enough for it."""


def __getattr__(name: str) -> Any:
    """Return `__version__`, which is read from the installation when it is asked for."""
    if name != "__version__":
        raise AttributeError(f"module 'thalweg' has no attribute {name!r}")
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("thalweg")
    except PackageNotFoundError:
        return "unknown"


def make_torch(level: str, num_envs: int = 1, **options: Any) -> "TensorRiverEnv":
    """Return N environments of a level whose observations, rewards and costs are tensors on one device.

    Args:
        level: "Easy", "Medium" or "Hard"; for boats (`vehicle="asv"`) "Easy", "Medium-Deep" or "Hard-Deep".
        num_envs: N, the number of environments.
        options: `device` ("auto" by default, see `thalweg.core.compute.device`), `world_seeds` or `worlds`, `banks`,
            `config`, and the fields of `thalweg.env.EnvConfig`.
    """
    from thalweg.env.factory import make_tensors

    return make_tensors(level, num_envs, **options)


def register_envs() -> None:
    """Register the Gymnasium ids of the levels; a second call changes nothing."""
    kwargs = {name: {"level": level} for level, name in LEVEL_IDS.items()}
    kwargs |= {name: {"level": level, "task": task} for (task, level), name in TASK_IDS.items()}
    kwargs |= {name: {"level": level, "vehicle": "asv"} for level, name in BOAT_IDS.items()}
    for name, arguments in kwargs.items():
        if name not in registry:
            register(
                id=name,
                entry_point="thalweg.env:make_single",
                vector_entry_point="thalweg.env:make_vector",
                kwargs=arguments,
            )


register_envs()
