from importlib.metadata import version

import pytest
import torch

from thalweg.core import machine as made
from thalweg.core.machine import machine, versions
from thalweg.train.folder import run_record as record


def test_the_versions_are_those_of_the_installed_packages():
    found = versions()
    assert set(found) == {"python", "thalweg", "numpy", "scipy", "numba", "torch", "gymnasium"}
    assert (found["scipy"], found["numba"]) == (version("scipy"), version("numba"))


def test_a_package_that_is_not_installed_is_unknown(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(made, "PARTS", ("no-such-package",))
    assert versions()["no-such-package"] == "unknown"


def test_the_machine_has_a_processor_and_memory():
    assert set(machine()) == {"cpu", "cores", "memory_gib", "system"}
    assert int(machine()["cores"]) >= 1


def test_a_run_on_a_gpu_names_the_card(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda: "NVIDIA Made-up")
    there, here = (record.describe(identity, 1)["machine"] for identity in ({"device": "cuda"}, {}))
    assert there["card"] == "NVIDIA Made-up" and set(there) - set(here) == {"card", "cuda", "numba-cuda"}
