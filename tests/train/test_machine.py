from importlib.metadata import version

import pytest

from thalweg.train import machine as made
from thalweg.train.machine import machine, versions


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
