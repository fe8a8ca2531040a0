"""Makes the virtual environment in which `peer.py` runs Safety-Gymnasium, whose pins conflict with Thalweg's own.

It lies in Thalweg's cache folder, is made whole or not at all, and is used again until a pin changes. What the
registry of Python packages does not hold, an old Python and a library for OpenGL, is asked for and never installed.
"""

import hashlib
import json
import os
import secrets
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from thalweg.cache import cache_dir

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


class SetupError(Exception):
    """What is missing on this machine, and what would mend it."""


@dataclass(frozen=True)
class Setup:
    """How Safety-Gymnasium is run here."""

    python: Path
    """Of its virtual environment."""
    gl: str
    """A key of `BACKENDS`."""
    opengl: str
    """Who draws, in OpenGL's words."""


def set_up(named: str | None) -> Setup:
    """Safety-Gymnasium, ready to draw; `named` is the Python to use, else one is looked for. Raises `SetupError`."""
    python = peer_python(named)
    return Setup(python, *backend(python))


def find_python(named: str | None) -> tuple[str, str]:
    """Path and version of a Python that Safety-Gymnasium runs under: the one named, else the newest on the path."""
    wanted = "3.8, 3.9 or 3.10"
    candidates = [named] if named else [f"python{major}.{minor}" for major, minor in PYTHONS]
    for candidate in candidates:
        path = shutil.which(candidate)
        asked = ["-I", "-c", "import platform; print(platform.python_version())"]
        found = subprocess.run([path, *asked], capture_output=True, text=True, check=False) if path else None
        if found is None or found.returncode:
            continue
        version = found.stdout.strip()
        if tuple(int(part) for part in version.split(".")[:2]) in PYTHONS:
            return str(path), version
        raise SetupError(f"Safety-Gymnasium needs Python {wanted}; {candidate} is Python {version}.")
    raise SetupError(
        f"Safety-Gymnasium needs Python {wanted}, and none of these runs here: {', '.join(candidates)}. "
        "Install one, for instance by `uv python install 3.10` or pyenv, or name it: --python PATH"
    )


def peer_python(named: str | None) -> Path:
    """The Python of the virtual environment with `PINS`, which is made first where it is missing (about a minute)."""
    key = hashlib.sha256("\n".join(PINS).encode()).hexdigest()[:16]
    parent = cache_dir() / "peer"
    ready = sorted(parent.glob(f"{key}-*/bin/python"))
    if ready and named is None:
        return ready[-1]
    base, version = find_python(named)
    home = parent / f"{key}-{version}"
    python = home / "bin" / "python"
    if not python.exists():
        print(f"making a virtual environment for Safety-Gymnasium under Python {version}", flush=True)
        make_whole(base, home)
    return python


def make_whole(base: str, home: Path) -> None:
    """A virtual environment of `base` with `PINS` at `home`: made beside it, then put there in one move."""
    home.parent.mkdir(parents=True, exist_ok=True)
    draft = home.with_name(f".{home.name}.{secrets.token_hex(8)}.part")
    pip = [str(draft / "bin" / "python"), "-I", "-m", "pip"]
    install = [*pip, "install", "--disable-pip-version-check", "--quiet", "--only-binary", ":all:", "--no-deps", *PINS]
    try:
        for command in ([base, "-m", "venv", str(draft)], install, [*pip, "check"]):
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                raise SetupError(f"{' '.join(command[1:4])} failed:\n{last_lines(done.stdout + done.stderr)}")
        os.replace(draft, home)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def last_lines(text: str, count: int = 8) -> str:
    """The end of what a process printed."""
    return "\n".join(text.strip().splitlines()[-count:])


def backend(python: Path) -> tuple[str, str]:
    """The first of `BACKENDS` that draws on the processor here, and who then draws; `SetupError` if there is none."""
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
    """Environment variables that have MuJoCo draw by one of `BACKENDS`."""
    return {"MUJOCO_GL": gl, "PYOPENGL_PLATFORM": gl, "LIBGL_ALWAYS_SOFTWARE": "1"}
