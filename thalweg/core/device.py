"""Where is it computed? On the CPU, or on a GPU of NVIDIA's: one name for worlds, frames, rules and learners.

Names are torch's: "cpu", "cuda", "cuda:1"; and "auto", the first GPU where there is one that works, else the CPU. A GPU
needs a torch that was built for CUDA, the package numba-cuda (thalweg[cuda]) and a card of `LEAST_CAPABILITY`. Nothing
of CUDA is imported before a GPU is asked for, nor torch for the CPU.
"""

import importlib.util

LEAST_CAPABILITY = (7, 5)
"""Of a card: Turing and later."""


class DeviceError(ValueError):
    """A device that there is not, or that can't be used, and what it lacks."""


def device_named(name: str) -> str:
    """The device of a name, as "cpu" or "cuda:0"; raises `DeviceError` for an unknown one, or a GPU that can't be used,
    saying why."""
    if name == "auto":
        return "cpu" if missing_for_cuda() else "cuda:0"
    kind, _, number = name.partition(":")
    if kind not in ("cpu", "cuda") or (number and not (kind == "cuda" and number.isdigit())):
        raise DeviceError(f"device = {name!r}: choose auto, cpu, cuda, or a GPU by its number, such as cuda:1")
    if kind == "cpu":
        return "cpu"
    index = int(number or 0)
    missing = missing_for_cuda(index)
    if missing:
        raise DeviceError(f"device = {name!r}: {missing}")
    return f"cuda:{index}"


def missing_for_cuda(index: int = 0) -> str:
    """What keeps the GPU of this number from being used; empty if nothing does."""
    import torch  # takes longer than all else that a world needs

    if torch.version.cuda is None:
        return f"torch {torch.__version__} was built without CUDA: install one that was, see pytorch.org"
    try:
        torch.cuda.init()
    except (RuntimeError, AssertionError) as error:  # no driver, or one that is too old; torch says which
        return str(error).strip().splitlines()[0]
    count = torch.cuda.device_count()
    if index >= count:
        return f"there is no GPU of number {index}; there are {count}, counted from 0"
    capability = torch.cuda.get_device_capability(index)
    if capability < LEAST_CAPABILITY:
        has, needs = (".".join(map(str, pair)) for pair in (capability, LEAST_CAPABILITY))
        return f"{torch.cuda.get_device_name(index)} has compute capability {has}; Thalweg needs {needs} or more"
    if importlib.util.find_spec("numba_cuda") is None:
        return "the package numba-cuda is missing: pip install 'thalweg[cuda]'"
    return ""
