"""Compilation of the frame's kernel: once for each version of its code, in a process of its own.

That process compiles while the first river is built, and all others load what it has stored. If it fails, the process
that draws compiles the kernel itself, and its frames are the same.
"""

import os
import subprocess
import sys
import threading
import warnings
from pathlib import Path

import numba
import numpy as np

from thalweg.core.compute.jit import kernel_cache_dir
from thalweg.core.compute.kernel_compiler import config
from thalweg.render.batch import FRAMES, draw_jobs, shared_buffers
from thalweg.render.records.appearance import LOOK_COLUMNS
from thalweg.render.records.props import NO_PROPS
from thalweg.render.records.scene import blank_scene
from thalweg.render.records.view import COLOURS, FrameSettings, Views, output

DONE = "frames.compiled"
"""File beside the compiled kernels that says they are complete."""
TIMEOUT_S = 900.0

_child: subprocess.Popen | None = None
_ready = False
_lock = threading.Lock()


def begin() -> None:
    """Start compiling in the background unless the kernel is compiled already, and print that; returns at once."""
    with _lock:
        _begin()


def _begin() -> None:
    global _child, _ready
    folder = kernel_cache_dir()
    # Without a cache folder every process compiles anew, with the same result each time.
    _ready = _ready or folder is None or config.DISABLE_JIT or (folder / DONE).exists()
    if _ready or _child is not None:
        return
    print("thalweg: compiling kernels: first start only, 30 to 60 seconds", file=sys.stderr, flush=True)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    _child = subprocess.Popen(
        [sys.executable, "-m", "thalweg.render.compilation"],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def finish() -> None:
    """Wait until the kernel is compiled. If the child process fails, warn; this process then compiles when it draws."""
    if not _ready:
        with _lock:  # threads that draw at once wait for the same process
            _finish()


def _finish() -> None:
    global _child, _ready
    _begin()
    if _child is not None:
        try:
            _, output = _child.communicate(timeout=TIMEOUT_S)
            lines = ["no message", *output.decode(errors="replace").strip().splitlines()]
            failure = f"{lines[-1]}; exit status {_child.returncode}" if _child.returncode else ""
        except subprocess.TimeoutExpired:
            _child.kill()
            failure = f"it took more than {TIMEOUT_S:.0f} s"
        if failure:
            warnings.warn(
                f"the frames' kernel could not be compiled in a process of its own ({failure}): this one compiles it",
                stacklevel=3,
            )
        _child = None
    _ready = True


def arguments() -> tuple:
    """Arguments for `draw_jobs` of the types with which it is called."""
    settings = FrameSettings(8, 8, np.float32(0.3), False)
    views = Views(np.zeros(1, np.int64), np.zeros((1, 4)), np.zeros(1), np.zeros((1, LOOK_COLUMNS), np.float32))
    bands = np.zeros((1, 2), np.int32)
    buffers = shared_buffers(0, 8, 8, COLOURS)
    return blank_scene(), views, settings, output(COLOURS), bands, NO_PROPS, buffers, FRAMES, 0, 1


def main() -> None:
    """Compile and store the kernel. The file `DONE` is made last, so that a killed process leaves none."""
    folder = kernel_cache_dir()
    assert folder is not None
    draw_jobs.compile(tuple(numba.typeof(argument) for argument in arguments()))
    Path(folder, DONE).touch()


def _drop_child() -> None:
    """Forget the compiling process in a forked process, which can't wait for it, and who holds the lock."""
    global _child, _lock
    _child, _lock = None, threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_drop_child)


if __name__ == "__main__":
    main()
