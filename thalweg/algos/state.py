"""Everything that learning would need to go on, as arrays and plain data: no pickles, hence no code."""

from typing import Any

import numpy as np
import torch
from torch import nn

from thalweg.algos.errors import AlgorithmError


def module_state(module: nn.Module) -> dict[str, np.ndarray]:
    """A copy of a module's parameters by name."""
    return {name: value.detach().cpu().numpy().copy() for name, value in module.state_dict().items()}


def load_module(module: nn.Module, state: dict[str, np.ndarray]) -> None:
    """The inverse of `module_state`; raises `AlgorithmError` naming both shapes where they differ."""
    here = {name: tuple(value.shape) for name, value in module.state_dict().items()}
    there = {name: tuple(np.shape(value)) for name, value in state.items()}
    if here != there:
        raise AlgorithmError(f"a network of shapes {here} can't take one of {there}")
    module.load_state_dict({name: torch.from_numpy(np.array(value)) for name, value in state.items()})


def optimiser_state(optimiser: torch.optim.Optimizer) -> dict[str, Any]:
    """A copy of what an optimiser remembers of each parameter, by the parameter's number."""
    remembered = optimiser.state_dict()["state"]
    return {
        str(number): {name: value.detach().cpu().numpy().copy() for name, value in memory.items()}
        for number, memory in remembered.items()
    }


def load_optimiser(optimiser: torch.optim.Optimizer, state: dict[str, Any]) -> None:
    """The inverse of `optimiser_state`; learning rates stay as they are."""
    memory = {
        int(number): {name: torch.from_numpy(np.array(value)) for name, value in values.items()}
        for number, values in state.items()
    }
    optimiser.load_state_dict({"state": memory, "param_groups": optimiser.state_dict()["param_groups"]})


def generator_state(generator: torch.Generator) -> np.ndarray:
    """The state of a random generator, uint8."""
    return generator.get_state().numpy().copy()


def load_generator(generator: torch.Generator, state: np.ndarray) -> None:
    """The inverse of `generator_state`."""
    generator.set_state(torch.from_numpy(np.array(state, dtype=np.uint8)))
