"""Plug-ins for tests: written to files, or installed as a distribution in a folder on the path."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from thalweg.core.plugins import lookup

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = ROOT / "examples" / "my_algorithm.py"
PAGE = (ROOT / "docs" / "extend.md").read_text()
(SQUARES,) = re.findall(r"```python\n(\"\"\"An encoder of masks.*?)```", PAGE, flags=re.DOTALL)
"""Source of the encoder in docs/extend.md."""
(NESTS,) = re.findall(r"```python\n(\"\"\"Nests whose.*?)```", PAGE, flags=re.DOTALL)
"""Source of the task in docs/extend.md."""


@pytest.fixture
def no_plugins(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A test that begins without plug-ins from files, and leaves none behind."""
    monkeypatch.setenv(lookup.VARIABLE, "")
    yield


def install(folder: Path, points: Mapping[str, Mapping[str, str]], name: str = "mine") -> None:
    """Install a distribution of version 1.0 into a folder: entry points by group, then name, as pip writes them."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = [
        f"[{group}]\n" + "".join(f"{key} = {value}\n" for key, value in of.items()) for group, of in points.items()
    ]
    (info / "entry_points.txt").write_text("\n".join(lines))
