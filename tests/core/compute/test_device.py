"""Tests of device names and of the messages for unusable GPUs, with PyTorch patched to answer as on other machines."""

import subprocess
import sys

import pytest
import torch

from thalweg.core.compute import device as devices
from thalweg.core.compute.device import DeviceError, resolve_device


@pytest.fixture
def two_gpus(monkeypatch: pytest.MonkeyPatch):
    """Patch PyTorch to report two usable GPUs; returns the monkeypatch for further changes."""
    monkeypatch.setattr(torch.version, "cuda", "13.0")
    monkeypatch.setattr(torch.cuda, "init", lambda: None)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    monkeypatch.setattr(torch.cuda, "get_device_capability", lambda _: (9, 0))
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda _: "NVIDIA Made-up")
    monkeypatch.setattr(devices.importlib.util, "find_spec", lambda _: "found")
    return monkeypatch


def test_names_are_those_of_pytorch(two_gpus: pytest.MonkeyPatch):
    named = {name: resolve_device(name) for name in ("cpu", "auto", "cuda", "cuda:1")}
    assert named == {"cpu": "cpu", "auto": "cuda:0", "cuda": "cuda:0", "cuda:1": "cuda:1"}


@pytest.mark.parametrize("name", ["gpu", "cuda:x", "cuda:-1", "cuda:²", "cpu:0", "CUDA", ""])
def test_unknown_names_are_refused_with_the_valid_ones(name: str):
    with pytest.raises(DeviceError, match=r"device = '.*': choose auto, cpu, cuda, or a GPU by its number, such as"):
        resolve_device(name)


def test_devices_of_pytorch_are_taken(two_gpus: pytest.MonkeyPatch):
    given = [torch.device("cpu"), torch.device("cuda"), torch.device("cuda", 1)]
    assert [resolve_device(device) for device in given] == ["cpu", "cuda:0", "cuda:1"]


@pytest.mark.parametrize("name", [0, None, b"cpu", ["cpu"]])
def test_what_is_no_name_is_refused(name):
    with pytest.raises(DeviceError, match=r"device = .*: give a name such as cpu or cuda:1, or a torch\.device"):
        resolve_device(name)


def test_auto_is_the_cpu_without_pytorch(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    assert resolve_device("auto") == "cpu"
    with pytest.raises(DeviceError, match="device = 'cuda': PyTorch is not installed"):
        resolve_device("cuda")


def test_auto_is_the_cpu_without_a_usable_gpu(two_gpus: pytest.MonkeyPatch):
    two_gpus.setattr(torch.cuda, "device_count", lambda: 0)
    assert resolve_device("auto") == "cpu"


def test_a_pytorch_build_without_cuda_is_reported(two_gpus: pytest.MonkeyPatch):
    two_gpus.setattr(torch.version, "cuda", None)
    with pytest.raises(DeviceError, match=r"'cuda': torch .* was built without CUDA: install a build with CUDA"):
        resolve_device("cuda")


def test_the_driver_error_of_pytorch_is_passed_on(two_gpus: pytest.MonkeyPatch):
    def old():
        raise RuntimeError("The NVIDIA driver on your system is too old (found version 11040).\nPlease update it.")

    two_gpus.setattr(torch.cuda, "init", old)
    with pytest.raises(DeviceError, match=r"'cuda:1': The NVIDIA driver .* too old \(found version 11040\)\.$"):
        resolve_device("cuda:1")


def test_a_missing_gpu_is_reported_with_the_number_of_gpus(two_gpus: pytest.MonkeyPatch):
    with pytest.raises(DeviceError, match=r"'cuda:2': there is no GPU with index 2; found 2, counted from 0"):
        resolve_device("cuda:2")


def test_a_gpu_that_is_too_old_is_reported_with_the_required_capability(two_gpus: pytest.MonkeyPatch):
    two_gpus.setattr(torch.cuda, "get_device_capability", lambda _: (6, 1))
    with pytest.raises(DeviceError, match=r"Made-up has compute capability 6\.1; Thalweg needs 7\.5 or more"):
        resolve_device("cuda")


def test_a_missing_package_is_reported_with_how_to_install_it(two_gpus: pytest.MonkeyPatch):
    two_gpus.setattr(devices.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(DeviceError, match=r"numba-cuda is missing: .* pip install '\.\[cuda\]'"):
        resolve_device("cuda")


def test_importing_thalweg_imports_neither_pytorch_nor_cuda():
    code = (
        "import sys; import thalweg.render; from thalweg.core.compute import device; device.resolve_device('cpu');"
        "print([name for name in ('torch', 'numba.cuda', 'numba_cuda') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
