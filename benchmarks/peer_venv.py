"""Virtual environments for peers whose pins conflict with Thalweg's own: made whole or not at all, kept in its cache.

An environment is used again until a pin, or what else goes into its key, changes. A Python that this machine lacks is
asked for and never installed.
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
    """What is missing on this machine, and what would mend it."""


@dataclass(frozen=True)
class Recipe:
    """How the virtual environment of a peer is made."""

    peer: str
    """Its name."""
    pythons: tuple[tuple[int, int], ...]
    """Versions it runs under, the preferred one first."""
    installs: tuple[tuple[str, ...], ...]
    """Arguments of `pip install`, one call after another."""
    finish: Callable[[Path], None]
    """Ends the work, given the new environment's Python; raises `SetupError` if it is of no use."""
    folder: str = "peer"
    """Inside Thalweg's cache folder."""
    finishing: str = ""
    """Goes into the key beside `installs`: to be changed with `finish`."""

    @property
    def key(self) -> str:
        """Changes with whatever would make another environment."""
        pins = [word for install in self.installs for word in install if "==" in word]
        return hashlib.sha256("\n".join([*pins, *filter(None, [self.finishing])]).encode()).hexdigest()[:16]

    @property
    def wanted(self) -> str:
        """The versions in words, the oldest first."""
        names = [f"{major}.{minor}" for major, minor in sorted(self.pythons)]
        return " or ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def python_of(recipe: Recipe, named: str | None = None) -> Path:
    """The Python of the virtual environment, which is made first where it is missing (about a minute); `named` is the
    Python to make it from, else one is looked for. Raises `SetupError`."""
    parent = cache_dir() / recipe.folder
    ready = sorted(parent.glob(f"{recipe.key}-*/bin/python"))
    if ready and named is None:
        return ready[-1]
    base, version = find_python(recipe, named)
    home = parent / f"{recipe.key}-{version}"
    python = home / "bin" / "python"
    if not python.exists():
        print(f"making a virtual environment for {recipe.peer} under Python {version}", flush=True)
        make_whole(recipe, base, home)
    return python


def find_python(recipe: Recipe, named: str | None) -> tuple[str, str]:
    """Path and version of a Python that the peer runs under: the one named, else the first of `pythons` on the path."""
    candidates = [named] if named else [f"python{major}.{minor}" for major, minor in recipe.pythons]
    for candidate in candidates:
        path = shutil.which(candidate)
        asked = ["-I", "-c", "import platform; print(platform.python_version())"]
        found = subprocess.run([path, *asked], capture_output=True, text=True, check=False) if path else None
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


def make_whole(recipe: Recipe, base: str, home: Path) -> None:
    """The virtual environment of the Python `base` at `home`: made beside it, then put there in one move."""
    home.parent.mkdir(parents=True, exist_ok=True)
    draft = home.with_name(f".{home.name}.{secrets.token_hex(8)}.part")
    python = draft / "bin" / "python"
    pip = [str(python), "-I", "-m", "pip", "install", "--disable-pip-version-check", "--quiet"]
    try:
        call([base, "-m", "venv", str(draft)])
        for install in recipe.installs:
            call([*pip, *install])
        recipe.finish(python)
        os.replace(draft, home)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def call(command: Sequence[str]) -> None:
    """Run it; raises `SetupError` with the end of what it printed if it fails."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SetupError(f"{' '.join(command[1:4])} failed:\n{last_lines(done.stdout + done.stderr)}")


def last_lines(text: str, count: int = 8) -> str:
    """The end of what a process printed."""
    return "\n".join(text.strip().splitlines()[-count:])
