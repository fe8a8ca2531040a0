"""Functions over all environments of tensors: a loop on the CPU, or a kernel of `cuda_step` on a GPU."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from thalweg.core.compute import gpu
from thalweg.core.compute.launch_graphs import LaunchGraphs


class Launcher:
    """Runs functions on the tensors of N environments on one device."""

    def __init__(self, device: torch.device, num_envs: int) -> None:
        self.device, self.num_envs = device, num_envs
        self._graphs = LaunchGraphs(device)
        """CUDA graphs of the launches of a step, whose arguments never change."""

    def tensor(self, values: np.ndarray) -> Tensor:
        """Return a copy of an array on the device."""
        return torch.from_numpy(np.array(values)).to(self.device)

    def array(self, tensor: Tensor) -> Any:
        """Return the kernels' view of a tensor."""
        return tensor.numpy() if self.device.type == "cpu" else gpu.as_kernel_array(tensor)

    def run(self, name: str, on_cpu: Callable[..., None], arguments: Callable[[], tuple[Any, ...]]) -> None:
        """Run a function on the CPU, or launch the kernel of that name in `cuda_step`, or replay its launch.

        A kernel always has the same arguments.
        """
        if self.device.type == "cpu":
            on_cpu(*arguments())
            return
        from thalweg.env.device import cuda_step

        kernel, blocks = getattr(cuda_step, name), -(-self.num_envs // cuda_step.THREADS)
        self._graphs.run(
            name, lambda: gpu.launch(kernel, blocks, cuda_step.THREADS, self.device, *arguments(), fastmath=False)
        )
