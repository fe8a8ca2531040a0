"""Virtual environments for peers whose pins conflict with Thalweg's own: created atomically, kept in its cache.

An environment is reused until a pin, or another part of its key, changes. A missing version of Python is an error; it
is never installed.
"""

import hashlib
import os
import secrets
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from thalweg.core.cache import cache_dir


class SetupError(Exception):
    """Raised with what is missing on this machine, and how to get it."""


@dataclass(frozen=True)
class Recipe:
    """How the virtual environment of a peer is created."""

    peer: str
    """Name of the peer."""
    pythons: tuple[tuple[int, int], ...]
    """Python versions that it supports, the preferred one first."""
    installs: tuple[tuple[str, ...], ...]
    """Arguments of successive calls of `pip install`."""
    finish: Callable[[Path], None]
    """Completes the new environment, given its Python; raises `SetupError` if it does not work."""
    folder: str = "peer"
    """Folder within Thalweg's cache."""
    finishing: str = ""
    """Part of the key beside `installs`: must change when `finish` does."""

    @property
    def key(self) -> str:
        """Hash of everything that the environment depends on."""
        pins = [word for install in self.installs for word in install if "==" in word]
        return hashlib.sha256("\n".join([*pins, *filter(None, [self.finishing])]).encode()).hexdigest()[:16]

    @property
    def wanted(self) -> str:
        """Supported versions in words, the oldest first."""
        names = [f"{major}.{minor}" for major, minor in sorted(self.pythons)]
        return " or ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def python_of(recipe: Recipe, named: str | None = None) -> Path:
    """Return the Python of the virtual environment, which is created if missing (about a minute).

    `named` is the Python to create it from, by default one is searched for. Raises `SetupError`.
    """
    parent = cache_dir() / recipe.folder
    ready = sorted(parent.glob(f"{recipe.key}-*/bin/python"))
    if ready and named is None:
        return ready[-1]
    base, version = find_python(recipe, named)
    folder = parent / f"{recipe.key}-{version}"
    python = folder / "bin" / "python"
    if not python.exists():
        print(f"making a virtual environment for {recipe.peer} under Python {version}", flush=True)
        create_venv(recipe, base, folder)
    return python


def find_python(recipe: Recipe, named: str | None) -> tuple[str, str]:
    """Return path and version of a supported Python: the one named, or the first of `pythons` on the path."""
    candidates = [named] if named else [f"python{major}.{minor}" for major, minor in recipe.pythons]
    for candidate in candidates:
        path = shutil.which(candidate)
        arguments = ["-I", "-c", "import platform; print(platform.python_version())"]
        found = subprocess.run([path, *arguments], capture_output=True, text=True, check=False) if path else None
        if found is None or found.returncode:
            continue
        version = found.stdout.strip()
        if tuple(int(part) for part in version.split(".")[:2]) in recipe.pythons:
            return str(path), version
        raise SetupError(f"{recipe.peer} needs Python {recipe.wanted}; {candidate} is Python {version}.")
    newest = ".".join(map(str, recipe.pythons[0]))
    raise SetupError(
        f"{recipe.peer} needs Python {recipe.wanted}, and none of these runs here: {', '.join(candidates)}. "
        f"Install one, for instance by `uv python install {newest}` or pyenv, or name it: --python PATH"
    )


def create_venv(recipe: Recipe, base: str, folder: Path) -> None:
    """Create the virtual environment of the Python `base` beside `folder`, then move it there in one step."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    draft = folder.with_name(f".{folder.name}.{secrets.token_hex(8)}.part")
    python = draft / "bin" / "python"
    pip = [str(python), "-I", "-m", "pip", "install", "--disable-pip-version-check", "--quiet"]
    try:
        call([base, "-m", "venv", str(draft)])
        for install in recipe.installs:
            call([*pip, *install])
        recipe.finish(python)
        os.replace(draft, folder)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def call(command: Sequence[str]) -> None:
    """Run a command; raises `SetupError` with the end of its output if it fails."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SetupError(f"{' '.join(command[1:4])} failed:\n{last_lines(done.stdout + done.stderr)}")


def last_lines(text: str, count: int = 8) -> str:
    """Return the last lines of a text."""
    return "\n".join(text.strip().splitlines()[-count:])
