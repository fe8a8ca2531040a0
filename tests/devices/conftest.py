"""The pretended device, as tests of recorded gradient steps use it."""

from collections.abc import Iterator

import pytest

from tests.devices.pretend import Device, pretended, record
from thalweg.algos.common import cuda_graphs


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Device]:
    """A device that is there while a test runs, on which gradient steps are recorded as on a GPU."""
    with pretended(monkeypatch) as device:
        monkeypatch.setattr(cuda_graphs, "recorded", lambda step, generators: record(device, step))
        monkeypatch.setattr(cuda_graphs, "beside", lambda step, rows: step(rows))
        yield device
