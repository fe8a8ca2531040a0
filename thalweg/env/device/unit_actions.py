"""Unit actions from tensors, as `thalweg.env.spaces.to_unit_actions` makes them from arrays."""

import torch
from torch import Tensor

from thalweg.env.spaces import FORWARD, ActionError
from thalweg.env.task.motion import ROUNDING


def tensor_unit_actions(kind: str, actions: Tensor, count: int, fast_ratio: float = 0.0) -> Tensor:
    """Return actions [N, 4] of the space as unit actions [N, 4] float64 on their device, where values out of range are
    clipped and NaN is no move, because checking them would make the host wait.

    The arguments are those of `to_unit_actions`. Raises `ActionError` for a wrong shape or type.
    """
    if actions.shape != (count, 4):
        raise ActionError(f"actions have shape {tuple(actions.shape)}; needed: ({count}, 4)")
    integers = not (actions.is_floating_point() or actions.is_complex() or actions.dtype == torch.bool)
    if kind == "multidiscrete":
        if not integers:
            raise ActionError(f"actions have type {actions.dtype}; multidiscrete actions are integers 0, 1 or 2")
        return (1.0 - actions.double()).clamp(-1.0, 1.0).contiguous()
    if not (integers or actions.is_floating_point()):
        raise ActionError(f"actions have type {actions.dtype}; continuous actions are numbers in -1..1")
    units = actions.double().clamp(-1.0, 1.0).nan_to_num(nan=0.0)
    if fast_ratio:
        share = units[:, FORWARD].clamp(min=0.0)
        steps = share * fast_ratio
        units[:, FORWARD] = torch.where(steps <= 1.0 + ROUNDING, steps.clamp(max=1.0), -share)
    return units.contiguous()
