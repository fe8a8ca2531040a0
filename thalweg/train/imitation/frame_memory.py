"""Memory for the frames of an imitation, checked before work begins."""

from thalweg.algos.imitation.config import CHANNELS, IMAGE_PX, ImitationConfig
from thalweg.train.errors import TrainingError
from thalweg.world.generate.memory import free_bytes

DRAWN_COPIES = 2
"""Copies of frames that are drawn or read: images, and rows with the last action."""
MIRROR_COPIES = 3
"""Copies of frames while they are mirrored: as they were, mirrored, and as rows with the last action."""


def copies_of_flights(config: ImitationConfig) -> float:
    """Return how many frames are in memory at once for each step that is flown until an update."""
    return 1 + max(MIRROR_COPIES * config.in_mirror, copies_of_drawn(config) * config.replay)


def copies_of_drawn(config: ImitationConfig) -> float:
    """Return how many frames are in memory at once for each step that is drawn anew or read, some of them mirrored."""
    return DRAWN_COPIES + config.mirrored


def check_frame_memory(config: ImitationConfig, num_envs: int, copies: float, name: str = "num_envs") -> None:
    """Raise `TrainingError` if `copies` of the frames of `num_envs` sequences, the argument `name`, do not fit into the
    free memory."""
    step = copies * IMAGE_PX**2 * CHANNELS[config.observation]
    needed, free = num_envs * config.sequence * step, free_bytes()
    if free is None or needed <= free:
        return
    told = f"their frames take {needed / 1e9:.2f} GB, and {free / 1e9:.2f} GB of memory are free"
    length = f"a sequence of {config.sequence:,} steps"
    if fitting := int(free // (config.sequence * step)):
        raise TrainingError(f"{name} must be at most {fitting:,}, not {num_envs:,}, with {length}: {told}")
    if fitting := int(free // (num_envs * step)):
        raise TrainingError(f"sequence must be at most {fitting:,} steps, not {config.sequence:,}: {told}")
    raise TrainingError(f"{name} = {num_envs:,} and {length} are both too large: {told}")
