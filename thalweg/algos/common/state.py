"""Conversion of tensors, modules and generators to arrays and plain data, which need no pickle, and back."""

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from thalweg.algos.common.errors import AlgorithmError

CPU = torch.device("cpu")


def array_of(tensor: Tensor) -> np.ndarray:
    """A copy of a tensor's numbers on the host, wherever it lies."""
    return tensor.detach().cpu().numpy().copy()


def tensor_of(array: Any, device: torch.device) -> Tensor:
    """A copy of an array's numbers on a device."""
    return torch.from_numpy(np.array(array)).to(device)


def new_generator(device: torch.device, seed: int = 0) -> torch.Generator:
    """Random numbers of a device; the same seed gives other numbers on a GPU than on the CPU."""
    return torch.Generator(device).manual_seed(seed)


def module_state(module: nn.Module) -> dict[str, np.ndarray]:
    """A copy of a module's parameters by name."""
    return {name: array_of(value) for name, value in module.state_dict().items()}


def load_module(module: nn.Module, state: dict[str, np.ndarray]) -> None:
    """The inverse of `module_state`; raises `AlgorithmError` naming both shapes where they differ."""
    here = {name: tuple(value.shape) for name, value in module.state_dict().items()}
    there = {name: tuple(np.shape(value)) for name, value in state.items()}
    if here != there:
        raise AlgorithmError(f"a network of shapes {here} can't take one of {there}")
    module.load_state_dict({name: tensor_of(value, CPU) for name, value in state.items()})


def generator_state(generator: torch.Generator) -> np.ndarray:
    """The state of a random generator, uint8."""
    return generator.get_state().numpy().copy()


def load_generator(generator: torch.Generator, state: np.ndarray) -> None:
    """The inverse of `generator_state`."""
    generator.set_state(torch.from_numpy(np.array(state, dtype=np.uint8)))
