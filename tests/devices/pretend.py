"""A device that there is on every machine: its tensors can't be mixed with those of the CPU, nor be read without
copying them first. What runs on it would run on a GPU, as far as it is a matter of where tensors lie.

Its name is torch's "meta", under which torch keeps tensors without numbers; here the numbers lie behind them on the
CPU.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import pytest
import torch
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map

PRETEND = torch.device("meta")
ATEN = torch.ops.aten
READS = (ATEN._local_scalar_dense.default, ATEN.nonzero.default)
COPIES = (ATEN._to_copy.default, ATEN.copy_.default)
"""Operations that may mix tensors of both devices."""


class Mixed(RuntimeError):
    """Tensors of two devices in one call, or one that is read where it does not lie."""


class Pretend(torch.Tensor):
    """A tensor of that device."""

    held: torch.Tensor

    @staticmethod
    def __new__(cls, held: torch.Tensor) -> "Pretend":
        made = torch.Tensor._make_wrapper_subclass(  # pyright: ignore[reportAttributeAccessIssue]
            cls, held.shape, strides=held.stride(), dtype=held.dtype, device=PRETEND
        )
        made.held = held
        return made

    @classmethod
    def __torch_function__(cls, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        if function is torch.Tensor.data_ptr:
            return args[0].held.data_ptr()
        if getattr(function, "__self__", None) is torch.Tensor.is_meta:
            return False
        if function is torch.Tensor.new_tensor:
            return torch.tensor(args[1], dtype=args[0].dtype).to(PRETEND)
        if function is torch.Tensor.tolist:
            return args[0].cpu().tolist()
        if function in (torch.Tensor.numpy, torch.Tensor.__array__):
            raise Mixed("a tensor of the device was taken for an array")
        with torch._C.DisableTorchFunctionSubclass():
            return function(*args, **(kwargs or {}))

    @classmethod
    def __torch_dispatch__(cls, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        raise Mixed("a tensor of the device was used after it was left")


class Device(TorchDispatchMode):
    """While it is entered, the device is there; it counts what is copied and what a GPU would launch."""

    def __init__(self) -> None:
        super().__init__()
        self.copied: Counter[str] = Counter()
        """Tensors copied "to the host" and "to the device", and numbers "read" by the host."""
        self.recording: list[Recorded] | None = None
        """What is being recorded as a graph, if anything is."""
        self.launched = 0
        """Operations that compute; some take a GPU more than one kernel."""

    def __torch_dispatch__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = dict(kwargs or {})
        tensors = [each for each in tree_leaves((args, kwargs)) if isinstance(each, torch.Tensor)]
        ours = {id(each.held): each for each in tensors if isinstance(each, Pretend)}
        onto = kwargs.get("device")
        makes = onto is not None and torch.device(onto) == PRETEND
        if not ours and not makes:
            return function(*args, **kwargs)
        others = [each for each in tensors if not isinstance(each, Pretend) and each.dim() > 0]
        if self.recording is not None and (others or function in READS or not (makes or ours)):
            raise Mixed(f"{function} has to do with the host, and can't be recorded")
        if ours and others and function not in COPIES:
            raise Mixed(f"{function} was given tensors of the device and of the CPU, {[list(x.shape) for x in others]}")
        to_host = bool(ours) and onto is not None and not makes
        self.copied["to the host"] += to_host or (function is COPIES[1] and not isinstance(args[0], Pretend))
        self.copied["to the device"] += bool(others) and not to_host and function in COPIES
        self.copied["read"] += function in READS
        self.launched += computes(function)
        if onto is not None:
            kwargs["device"] = torch.device("cpu")
        held_args, held_kwargs = tree_map(lambda x: x.held if isinstance(x, Pretend) else x, (args, kwargs))
        found = function(*held_args, **held_kwargs)
        if self.recording is not None and computes(function):
            self.recording.append(Recorded(function, held_args, held_kwargs, found))
        if function is ATEN._to_copy.default and (makes or to_host):
            found = found.clone()
        if to_host or (function is COPIES[1] and not isinstance(args[0], Pretend)):
            return found if to_host else args[0]

        def wrapped(each: Any) -> Any:
            if not isinstance(each, torch.Tensor):
                return each
            return ours[id(each)] if id(each) in ours else Pretend(each)

        return tree_map(wrapped, found)


class Recorded(NamedTuple):
    """An operation of a graph, with the memory that it reads and writes."""

    function: Any
    args: Any
    kwargs: Any
    found: Any

    def again(self) -> None:
        """Do it once more into the same memory."""
        found = self.function(*self.args, **self.kwargs)
        for old, new in zip(tree_leaves(self.found), tree_leaves(found), strict=True):
            if isinstance(old, torch.Tensor) and old.data_ptr() != new.data_ptr():
                old.copy_(new)


def record(device: Device, step: Callable[[], None]) -> Callable[[], None]:
    """As `thalweg.algos.common.cuda_graphs.recorded`, of a step on the device."""
    device.recording = operations = []
    try:
        step()
    finally:
        device.recording = None

    def replay() -> None:
        for operation in operations:
            operation.again()

    return replay


def computes(function: Any) -> bool:
    """Whether an operation does more than to see its tensors otherwise or to set memory aside."""
    schema = function._schema
    views = any(each.alias_info is not None and not each.alias_info.is_write for each in schema.returns)
    return not views and not schema.name.startswith(("aten::empty", "aten::new_empty", "aten::_unsafe_view"))


class Made(TorchFunctionMode):
    """What `torch.tensor` makes for the device is made on the CPU first: torch would leave its numbers out."""

    def __torch_function__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = dict(kwargs or {})
        onto = kwargs.get("device")
        if function is torch.tensor and onto is not None and torch.device(onto) == PRETEND:
            return function(*args, **kwargs | {"device": "cpu"}).to(PRETEND)
        return function(*args, **kwargs)


class Draws(torch.Generator):
    """Random numbers of the device."""

    @property
    def device(self) -> torch.device:
        return PRETEND


@contextmanager
def pretended(monkeypatch: pytest.MonkeyPatch) -> Iterator[Device]:
    """The device, where `thalweg.algos.common.state.new_generator` knows it."""
    from thalweg.algos.common import state

    before = state.new_generator

    def made(device: torch.device, seed: int = 0) -> torch.Generator:
        return Draws().manual_seed(seed) if device == PRETEND else before(device, seed)

    # Torch can't take a tensor made by a subclass into this mode, which is `no_grad` and more.
    without: list[torch.no_grad] = []

    def enter(self: Any) -> None:
        without.append(torch.no_grad())
        without[-1].__enter__()

    monkeypatch.setattr(torch.inference_mode, "__enter__", enter)
    monkeypatch.setattr(torch.inference_mode, "__exit__", lambda self, *error: without.pop().__exit__(*error))
    monkeypatch.setattr(torch.nn.init, "orthogonal_", _orthogonal(torch.nn.init.orthogonal_))
    for module in [m for name, m in sys.modules.items() if name.startswith("thalweg.algos")]:
        if getattr(module, "new_generator", None) is before:
            monkeypatch.setattr(module, "new_generator", made)
    with Made(), Device() as device:
        yield device


def _orthogonal(before: Any) -> Any:
    """It turns a matrix within its own memory, which would leave a wrapper with the shape it had."""

    def orthogonal(weight: torch.Tensor, gain: float, generator: torch.Generator) -> torch.Tensor:
        if not isinstance(weight, Pretend):
            return before(weight, gain, generator)
        return weight.copy_(before(weight.held, gain, generator).to(PRETEND))

    return orthogonal
