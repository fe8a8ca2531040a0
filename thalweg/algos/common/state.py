"""Conversion of tensors, modules and generators to arrays and plain data, which need no pickle, and back."""

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from thalweg.algos.common.errors import AlgorithmError

CPU = torch.device("cpu")


def array_of(tensor: Tensor) -> np.ndarray:
    """Return a tensor as a new NumPy array."""
    return tensor.detach().cpu().numpy().copy()


def tensor_of(array: Any, device: torch.device) -> Tensor:
    """Return an array as a new tensor on a device."""
    return torch.from_numpy(np.array(array)).to(device)


def new_generator(device: torch.device, seed: int = 0) -> torch.Generator:
    """Return a random generator on a device; GPUs and CPUs draw different numbers from the same seed."""
    return torch.Generator(device).manual_seed(seed)


def module_state(module: nn.Module) -> dict[str, np.ndarray]:
    """Return copies of a module's parameters, by name."""
    return {name: array_of(value) for name, value in module.state_dict().items()}


def load_module(module: nn.Module, state: dict[str, np.ndarray]) -> None:
    """Load what `module_state` returned; raises `AlgorithmError` naming each tensor whose shape differs."""
    here = {name: tuple(value.shape) for name, value in module.state_dict().items()}
    there = {name: tuple(np.shape(value)) for name, value in state.items()}
    if here != there:
        differing = [
            f"{name} has the shape {here.get(name, 'none')} here and {there.get(name, 'none')} in what is loaded"
            for name in here | there
            if here.get(name) != there.get(name)
        ]
        raise AlgorithmError(f"the network is another one: {'; '.join(differing)}")
    module.load_state_dict({name: tensor_of(value, CPU) for name, value in state.items()})


def generator_state(generator: torch.Generator) -> np.ndarray:
    """Return the state of a random generator, uint8."""
    return generator.get_state().numpy().copy()


def load_generator(generator: torch.Generator, state: np.ndarray) -> None:
    """Restore what `generator_state` returned."""
    generator.set_state(torch.from_numpy(np.array(state, dtype=np.uint8)))
