"""Virtual environment of OmniSafe 0.5.0: pinned packages, and one repair that Python 3.11 makes necessary.

OmniSafe always imports Safety-Gymnasium, whose dataclasses have arrays as defaults, which Python 3.11 refuses. They are
replaced by default factories; nothing else is changed.
"""

import re
from pathlib import Path

from benchmarks.peer_venv import Recipe, SetupError, call, python_of

PINS = (
    "torch==2.13.0",
    "numpy==1.26.4",
    "scipy==1.17.1",
    "gymnasium==0.28.1",
    "mujoco==2.3.3",
    "pygame==2.1.3",
    "xmltodict==0.14.2",
    "imageio==2.35.1",
    "jinja2==3.1.4",
    "pandas==2.0.3",
    "scikit-learn==1.3.2",
    "joblib==1.3.2",
    "cvxopt==1.3.2",
    "matplotlib==3.10.1",
    "seaborn==0.13.2",
    "moviepy==1.0.3",
    "tensorboard==2.19.0",
    "wandb==0.19.8",
    "gdown==5.2.0",
    "rich==13.9.4",
    "typer==0.15.2",
    "pyyaml==6.0.2",
    "tqdm==4.67.1",
    "linear-operator==0.5.2",
)
"""Packages that are installed with their dependencies."""
ALONE = (
    "omnisafe==0.5.0",
    "safety-gymnasium==1.0.0",
    "gymnasium-robotics==1.2.2",
    "pettingzoo==1.24.3",
    "gpytorch==1.11",
    "qpth==0.0.16",
)
"""Packages that are installed without their dependencies, which include versions of NumPy and pygame that don't exist
for Python 3.11, and a solver that only offline algorithms use."""
DEFAULTS = 24
"""Number of arrays that are defaults in Safety-Gymnasium 1.0.0."""
MUTABLE = re.compile(r"^(    \w+: np\.array = )((?:COLOR|GROUP)\[.*\])$", re.MULTILINE)
IMPORT = re.compile(r"^from dataclasses import dataclass$", re.MULTILINE)


def python_with_omnisafe(named: str | None = None) -> Path:
    """Return the Python of OmniSafe's virtual environment, which is created if missing (about two minutes).

    `named` is the Python 3.11 to create it from, by default the one on the path. Raises `SetupError`.
    """
    return python_of(RECIPE, named)


def with_factories(source: str) -> tuple[str, int]:
    """Return a source file with default factories in place of arrays, and the number of replacements."""
    mended, count = MUTABLE.subn(r"\1field(default_factory=lambda: \2)", source)
    return (IMPORT.sub("from dataclasses import dataclass, field", mended), count) if count else (source, 0)


def mend(package: Path) -> int:
    """Replace arrays by default factories in an installed Safety-Gymnasium; returns the number of replacements."""
    total = 0
    for file in sorted(package.rglob("*.py")):
        mended, count = with_factories(file.read_text(encoding="utf-8"))
        if count:
            file.write_text(mended, encoding="utf-8")
            total += count
    return total


def finish(python: Path) -> None:
    """Repair the Safety-Gymnasium of `python`, and import OmniSafe as a test; raises `SetupError` if either fails."""
    packages = list(python.parents[1].glob("lib/python*/site-packages/safety_gymnasium"))
    mended = sum(mend(package) for package in packages)
    if mended != DEFAULTS:
        raise SetupError(f"expected {DEFAULTS} arrays as defaults in Safety-Gymnasium, found {mended}")
    call([str(python), "-I", "-c", "import omnisafe"])


RECIPE = Recipe("OmniSafe", ((3, 11),), (PINS, ("--no-deps", *ALONE)), finish, "omnisafe", MUTABLE.pattern)
