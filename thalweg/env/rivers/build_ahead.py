"""Building of rivers ahead of their use, in a process of its own that yields to all others.

It builds into the cache folder, whose files are written whole or not at all. It ends when its input does, so also with
a parent that was killed.
"""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from thalweg.core.cache import is_stored
from thalweg.world import Level, World, WorldError, load_or_build
from thalweg.world.store.world_cache import cache_path

NICENESS = 10
LONGEST_S = 120.0
"""Time after which a river that is being built elsewhere is no longer waited for."""
POLL_S = 0.05


class BackgroundBuilder:
    """Builds the rivers of a list that are not in the cache folder, those that are waited for first."""

    def __init__(self, entries: Iterable[Any]) -> None:
        """`entries` are those of a `RiverList`. Starts no process if all rivers are built already."""
        missing = [entry for entry in entries if not isinstance(entry, World) and not is_stored(cache_path(*entry))]
        self.missing = len(missing)
        """Number of rivers that were not built at the start."""
        self._process: subprocess.Popen[str] | None = None
        self._owner = os.getpid()
        if missing:
            environment = {
                **os.environ,
                "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
                "NUMBA_NUM_THREADS": "1",
                "OMP_NUM_THREADS": "1",
            }
            self._process = subprocess.Popen(
                [sys.executable, "-m", "thalweg.env.rivers.build_ahead"],
                env=environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                text=True,
            )
            levels = dict.fromkeys(level for level, _ in missing)
            for level in levels:
                self._ask(level, [seed for of, seed in missing if of == level], urgent=False)

    def wait(self, entry: Any) -> None:
        """Return when a river is in the cache folder, or it is clear that it must be built here."""
        if self._process is None or isinstance(entry, World) or is_stored(cache_path(*entry)):
            return
        self._ask(entry[0], [entry[1]], urgent=True)
        until = time.monotonic() + LONGEST_S
        while (process := self._process) is not None and process.poll() is None and time.monotonic() < until:
            if is_stored(cache_path(*entry)):
                return
            time.sleep(POLL_S)

    def close(self) -> None:
        """End the process, and whoever waits for it; in a forked process, leave it to the parent."""
        process, self._process = self._process, None
        if process is not None and os.getpid() == self._owner:
            process.kill()
            process.wait()
            if process.stdin is not None:
                with contextlib.suppress(OSError):  # for what was still to be written
                    process.stdin.close()

    def _ask(self, level: Level, seeds: Sequence[int], urgent: bool) -> None:
        """Ask for rivers of a level; a process that has ended is not asked."""
        process, line = self._process, {"level": asdict(level), "seeds": seeds, "urgent": urgent}
        with contextlib.suppress(OSError, ValueError):
            if process is not None and process.stdin is not None:
                process.stdin.write(json.dumps(line) + "\n")
                process.stdin.flush()


def main() -> None:
    """Build the rivers that the lines of the standard input ask for, until it ends."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    queue: deque[tuple[Level, int]] = deque()
    news = threading.Condition()
    threading.Thread(target=_listen, args=(queue, news), daemon=True).start()
    while True:
        with news:
            news.wait_for(lambda: len(queue) > 0)
            level, seed = queue.popleft()
        if is_stored(cache_path(level, seed)):
            continue
        with contextlib.suppress(WorldError):  # who needs the river will see the error
            load_or_build(level, seed)
        if not is_stored(cache_path(level, seed)):
            sys.exit(1)  # nobody must wait for a file that does not come


def _listen(queue: "deque[tuple[Level, int]]", news: threading.Condition) -> None:
    """Put what is asked for into the queue, urgent rivers in front; end the process with its input."""
    for line in sys.stdin:
        asked = json.loads(line)
        level = Level(**{name: _tuple(value) for name, value in asked["level"].items()})
        entries = [(level, int(seed)) for seed in asked["seeds"]]
        with news:
            if asked["urgent"]:
                queue.extendleft(entries)
            else:
                queue.extend(entries)
            news.notify()
    os._exit(0)


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


if __name__ == "__main__":
    main()
