"""Layers of PyTorch without initial weights of their own."""

from typing import Any, TypeVar, cast

import torch
from torch import device as Device
from torch import nn
from torch.nn.utils import skip_init

Layer = TypeVar("Layer", bound=nn.Module)


def uninitialised(kind: type[Layer], *sizes: Any, device: Device | str = "cpu") -> Layer:
    """Return a layer on a device whose parameters, float32, hold anything, to be overwritten.

    Its own initialisation would draw from the global generator of the device.
    """
    return cast(Layer, skip_init(kind, *sizes, dtype=torch.float32, device=device))
