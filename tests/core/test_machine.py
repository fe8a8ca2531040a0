"""Tests of the recorded machine and package versions."""

from importlib.metadata import version

import pytest
import torch
from llvmlite import binding

from thalweg.core import machine
from thalweg.core.machine import machine_info, package_versions
from thalweg.train.folder import run_record as record


def test_versions_are_those_of_the_installed_packages():
    found = package_versions()
    assert set(found) == {"python", "thalweg", "numpy", "scipy", "numba", "torch", "gymnasium"}
    assert (found["scipy"], found["numba"]) == (version("scipy"), version("numba"))


def test_a_package_that_is_not_installed_is_unknown(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(machine, "PACKAGES", ("no-such-package",))
    assert package_versions()["no-such-package"] == "unknown"


def test_machine_info_has_processor_and_memory():
    found = machine_info()
    assert set(found) == {"cpu", "cpu_type", "vector_bits", "cores", "memory_gib", "system"}
    assert int(found["cores"]) >= 1
    assert found["cpu_type"] == binding.get_host_cpu_name()


def test_the_width_of_vectors_follows_its_setting(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("THALWEG_VECTOR_BITS", "256")
    assert int(machine_info()["vector_bits"]) <= 256


def test_a_run_on_a_gpu_records_the_gpu(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: "NVIDIA Made-up")
    on_gpu, on_cpu = (record.describe(identity, 1, {})["machine"] for identity in ({"device": "cuda"}, {}))
    assert on_gpu["card"] == "NVIDIA Made-up" and set(on_gpu) - set(on_cpu) == {"card", "cuda", "numba-cuda"}


def test_of_several_gpus_the_run_s_own_is_recorded(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device=None: f"NVIDIA {device}")
    assert record.describe({"device": "cuda"}, 1, {}, "cuda:1")["machine"]["card"] == "NVIDIA cuda:1"


def test_a_system_without_sysconf_has_no_known_memory(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delattr("os.sysconf")
    assert machine_info()["memory_gib"] == 0
