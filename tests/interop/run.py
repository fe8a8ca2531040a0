"""Runner of the tests of adapters, each in an environment with the library of its adapter.

python -m tests.interop.run [NAME ...], which `make test-interop` calls. `.venv-interop-NAME` sees the packages of the
environment that runs this and has, before them, those of `locks/NAME.lock`, which holds the library and what it needs
beside or instead of `requirements.lock`. It is made anew when a lock changes.
"""

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LOCKS = Path(__file__).with_name("locks")
EMPTY = {"omnisafe": ("safety_gymnasium", "wandb")}
"""Modules that a library imports but does not need here, for which empty ones stand: Safety-Gymnasium 1.0.0, of which
OmniSafe takes its own tasks, cannot be imported beside Gymnasium 1."""


def names() -> list[str]:
    """Return the names of all libraries."""
    return sorted(path.stem for path in LOCKS.glob("*.lock"))


def python_with(name: str) -> Path:
    """Return the Python of a library's environment, which is created if it is missing or out of date."""
    lock = LOCKS / f"{name}.lock"
    folder = ROOT / f".venv-interop-{name}"
    python, ready = folder / "bin" / "python", folder / ".ready"
    wanted = f"{sys.prefix}\n{(ROOT / 'requirements.lock').read_text()}{lock.read_text()}"
    if ready.exists() and ready.read_text() == wanted:
        return python
    print(f"making {folder.name}", flush=True)
    shutil.rmtree(folder, ignore_errors=True)
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    packages = next(folder.glob("lib/python*/site-packages"))
    base = Path(sys.prefix) / packages.relative_to(folder)
    # A line that begins with `import` is run: packages of the base come last, editable ones included.
    (packages / "base.pth").write_text(f"import site; site.addsitedir({str(base)!r})\n")
    pip = [str(python), "-m", "pip", "install", "--disable-pip-version-check", "--quiet"]
    subprocess.run([*pip, "--no-deps", "-r", str(lock)], check=True)
    for module in EMPTY.get(name, ()):
        (packages / f"{module}.py").touch()
    ready.write_text(wanted)
    return python


def main(chosen: list[str]) -> int:
    """Run the tests of the chosen libraries, or of all; returns 1 if some failed."""
    unknown = sorted(set(chosen) - set(names()))
    if unknown:
        print(f"unknown: {', '.join(unknown)}; known: {', '.join(names())}", file=sys.stderr)
        return 2
    failed = []
    for name in chosen or names():
        print(f"== {name}", flush=True)
        command = [str(python_with(name)), "-m", "pytest", "-q", f"tests/interop/test_{name}.py"]
        if subprocess.run(command, cwd=ROOT, check=False).returncode:
            failed.append(name)
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
