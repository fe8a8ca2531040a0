"""Device names for worlds, frames, rules and learners: the CPU or an NVIDIA GPU.

Names are those of PyTorch ("cpu", "cuda", "cuda:1") and "auto", which is the first GPU if it is usable, else the CPU. A
GPU needs a PyTorch that was built for CUDA, the package numba-cuda (extra [cuda]) and a compute capability of at least
`MIN_COMPUTE_CAPABILITY`. CUDA is imported only when a GPU is asked for, and PyTorch not for the CPU.
"""

import importlib.util
import sys
from typing import Any

from thalweg.core.extras import how_to_install

MIN_COMPUTE_CAPABILITY = (7, 5)
"""Turing and later."""


class DeviceError(ValueError):
    """An unknown device, or one that cannot be used; the message says what is missing."""


def resolve_device(name: Any) -> str:
    """Return the device of a name, or a `torch.device`, as "cpu" or "cuda:<index>".

    Raises `DeviceError` for an unknown name, for anything else, and for a GPU that cannot be used, with the reason.
    """
    torch = sys.modules.get("torch")
    if torch is not None and isinstance(name, torch.device):
        name = str(name)
    if not isinstance(name, str):
        raise DeviceError(f"device = {name!r:.60}: give a name such as cpu or cuda:1, or a torch.device")
    if name == "auto":
        return "cpu" if cuda_unavailable_reason() else "cuda:0"
    kind, _, number = name.partition(":")
    if kind not in ("cpu", "cuda") or (number and not (kind == "cuda" and number.isdecimal())):
        raise DeviceError(f"device = {name!r}: choose auto, cpu, cuda, or a GPU by its number, such as cuda:1")
    if kind == "cpu":
        return "cpu"
    index = int(number or 0)
    reason = cuda_unavailable_reason(index)
    if reason:
        raise DeviceError(f"device = {name!r}: {reason}")
    return f"cuda:{index}"


def cuda_unavailable_reason(index: int = 0) -> str:
    """Return why the GPU with this index cannot be used, or an empty string if it can."""
    try:
        import torch  # takes longer to import than everything else a world needs
    except ModuleNotFoundError:
        return f"PyTorch is not installed: {how_to_install('learn')}"

    if torch.version.cuda is None:
        return f"torch {torch.__version__} was built without CUDA: install a build with CUDA, see pytorch.org"
    try:
        torch.cuda.init()
    except (RuntimeError, AssertionError) as error:  # no driver, or one that is too old; torch says which
        return str(error).strip().splitlines()[0]
    count = torch.cuda.device_count()
    if index >= count:
        return f"there is no GPU with index {index}; found {count}, counted from 0"
    capability = torch.cuda.get_device_capability(index)
    if capability < MIN_COMPUTE_CAPABILITY:
        found, needed = (".".join(map(str, pair)) for pair in (capability, MIN_COMPUTE_CAPABILITY))
        return f"{torch.cuda.get_device_name(index)} has compute capability {found}; Thalweg needs {needed} or more"
    if importlib.util.find_spec("numba_cuda") is None:
        return f"the package numba-cuda is missing: {how_to_install('cuda')}"
    return ""
