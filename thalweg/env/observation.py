"""What is seen? The space of observations, and the step from rendered frames to them."""

from typing import Any

import gymnasium
import numpy as np


def observation_space(kind: str, height_px: int, width_px: int) -> gymnasium.spaces.Space:
    """The space of one environment's observation; `kind` as in `EnvConfig.observation`."""
    image = lambda channels: gymnasium.spaces.Box(0, 255, (height_px, width_px, channels), np.uint8)  # noqa: E731
    if kind == "dict":
        return gymnasium.spaces.Dict({"rgb": image(3), "mask": image(1)})
    if kind == "none":
        return gymnasium.spaces.Box(-np.inf, np.inf, (4,), np.float64)
    return image({"rgb+mask": 4, "rgb": 3, "mask": 1}[kind])


def observed(kind: str, frames: np.ndarray) -> Any:
    """Observations [N, ...] from frames [N, H, W, 4] uint8 (red, green, blue, mask); shares no memory but for
    `rgb+mask`."""
    if kind == "rgb+mask":
        return frames
    if kind == "dict":
        return {"rgb": frames[..., :3].copy(), "mask": frames[..., 3:].copy()}
    return frames[..., :3].copy() if kind == "rgb" else frames[..., 3:].copy()


def one_of(batch: Any, row: int) -> Any:
    """The observation of one environment out of a batch, copied."""
    return {key: value[row].copy() for key, value in batch.items()} if isinstance(batch, dict) else batch[row].copy()
