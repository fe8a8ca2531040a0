"""Set-up of Safety-Gymnasium for `peer.py`: pinned packages of its virtual environment, and an OpenGL backend.

An old Python and a library for OpenGL, which are no Python packages, must be there; they are never installed.
"""

import json
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

from peer_venv import Recipe, SetupError, call, last_lines, python_of

PINS = (
    "safety-gymnasium==1.0.0",
    # What safety-gymnasium 1.0.0 itself demands, to the version:
    "gymnasium==0.28.1",
    "gymnasium-robotics==1.2.2",
    "mujoco==2.3.3",
    "pygame==2.1.0",
    # What these need, in versions for every Python from 3.8 to 3.10:
    "numpy==1.23.5",
    "absl-py==2.1.0",
    "cloudpickle==3.1.0",
    "farama-notifications==0.0.4",
    "glfw==2.7.0",
    "imageio==2.35.1",
    "importlib-metadata==8.5.0",
    "jax-jumpy==1.0.0",
    "jinja2==3.1.4",
    "markupsafe==2.1.5",
    "pettingzoo==1.24.3",
    "pillow==10.4.0",
    "pyopengl==3.1.7",
    "pyyaml==6.0.2",
    "typing-extensions==4.12.2",
    "xmltodict==0.14.2",
    "zipp==3.20.2",
)
PYTHONS = ((3, 10), (3, 9), (3, 8))
"""Safety-Gymnasium 1.0.0 fails to import under 3.11 (arrays as defaults of its dataclasses); its MuJoCo has no 3.7."""
SIDE = Path(__file__).resolve().with_name("peer_side.py")
BACKENDS = {"osmesa": "libosmesa6", "egl": "libegl1 and libgl1-mesa-dri"}
"""Ways to draw without a display, values of `MUJOCO_GL`, the faster one first, and Debian's packages for each."""
SOFTWARE = ("llvmpipe", "softpipe")
"""Rasterisers that draw on the processor, as OpenGL names them."""


def check(python: Path) -> None:
    """Check that all requirements of the packages are met."""
    call([str(python), "-I", "-m", "pip", "check"])


RECIPE = Recipe("Safety-Gymnasium", PYTHONS, (("--only-binary", ":all:", "--no-deps", *PINS),), finish=check)


@dataclass(frozen=True)
class Setup:
    """How Safety-Gymnasium runs on this machine."""

    python: Path
    """Python of its virtual environment."""
    gl: str
    """A key of `BACKENDS`."""
    opengl: str
    """Name of the renderer, as OpenGL reports it."""


def set_up(named: str | None) -> Setup:
    """Set up Safety-Gymnasium; `named` is the Python to use, by default one is searched for. Raises `SetupError`."""
    python = python_of(RECIPE, named)
    return Setup(python, *backend(python))


def backend(python: Path) -> tuple[str, str]:
    """Return the first of `BACKENDS` that draws on the processor, and its renderer; raises `SetupError` without one."""
    failures = []
    for name in BACKENDS:
        environment = os.environ | drawing_by(name)
        command = [str(python), "-I", str(SIDE), "opengl"]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        drawer = json.loads(done.stdout) if done.returncode == 0 else ""
        if drawer.startswith(SOFTWARE):
            return name, drawer
        failures.append(f"  MUJOCO_GL={name}: {drawer or last_lines(done.stderr, 1)}")
    packages = "; ".join(f"for {name} {packages}" for name, packages in BACKENDS.items())
    raise SetupError(
        "\n".join(["MuJoCo finds no OpenGL that draws on the processor:", *failures, f"Debian has {packages}."])
    )


def drawing_by(gl: str) -> dict[str, str]:
    """Return the environment variables that make MuJoCo draw with one of `BACKENDS`."""
    return {"MUJOCO_GL": gl, "PYOPENGL_PLATFORM": gl, "LIBGL_ALWAYS_SOFTWARE": "1"}
