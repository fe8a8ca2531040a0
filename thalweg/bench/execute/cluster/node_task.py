"""What does a node of a cluster do? One run, in a folder of its own, of which it sends back what there is.

Nothing here knows of Ray: the run is done by a thread, while whoever asked is told from time to time how it stands.
"""

import socket
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.cluster.run_archive import Files, milestones, names_of, pack, unpack
from thalweg.bench.execute.executors import logged
from thalweg.bench.execute.rivers import Place, made_by
from thalweg.bench.results.results import RunRow
from thalweg.bench.suite.suites import Run, Suite

GLANCE_S = 0.5
"""Between two looks at whether a run is over."""


@dataclass(frozen=True)
class Order:
    """What is to be done, and what there is of it already."""

    run: Run
    suite: Suite
    place: Place
    files: Files
    """The run as it stands, see `thalweg.bench.execute.cluster.run_archive`."""
    made: dict[str, int | None]
    """What makes the results, as `made_by` says where they are gathered."""
    gather_s: float
    """Least time between two parcels that are sent back."""


@dataclass(frozen=True)
class News:
    """How a run stands."""

    node: str
    """The name of the machine."""
    files: Files | None = None
    """Everything that there is of the run; None if there is nothing new."""
    row: RunRow | None = None
    """What became of it, once it is over."""


def errand(order: Order) -> Iterator[News]:
    """Do a run and say how it stands: that it has begun, how far it is from time to time, and what it left.

    Raises `ResultsError` where this machine has another Thalweg, and `OSError` if its disk is full.
    """
    node = socket.gethostname()
    _require_same(order.made, node)
    yield News(node)
    with tempfile.TemporaryDirectory(prefix="thalweg-", ignore_cleanup_errors=True) as name:
        what = Path(name), order.run.name, order.suite.trials(order.run)
        unpack(order.files, Path(name), order.run.name)
        sent, sent_at = milestones(order.files), time.monotonic()
        doing = _Doing(order, Path(name))
        while not doing.over():
            if time.monotonic() - sent_at < order.gather_s or milestones(names_of(*what)) == sent:
                continue
            with suppress(
                FileNotFoundError
            ):  # the run removed something meanwhile: the next look finds what came instead
                files = pack(*what)
                sent, sent_at = milestones(files), time.monotonic()
                yield News(node, files)
        row = doing.row()
        yield News(node, pack(*what), row)


class _Doing:
    """A run that is being done by a thread."""

    def __init__(self, order: Order, folder: Path) -> None:
        self._said: RunRow | BaseException | None = None
        self._thread = threading.Thread(target=self._do, args=(order, folder), daemon=True)
        self._thread.start()

    def over(self) -> bool:
        """Whether it is over, after a moment at most."""
        self._thread.join(GLANCE_S)
        return not self._thread.is_alive()

    def row(self) -> RunRow:
        """What became of it, once it is over."""
        if isinstance(self._said, RunRow):
            return self._said
        raise self._said or RuntimeError("it is not over")

    def _do(self, order: Order, folder: Path) -> None:
        try:
            self._said = logged(order.run, order.suite, folder, order.place)
        except BaseException as error:
            self._said = error


def _require_same(made: dict[str, int | None], node: str) -> None:
    """Raise `ResultsError` that names each part in which this machine's Thalweg differs."""
    here = made_by()
    changes = [f"{key} {here.get(key)} there, {mark} here" for key, mark in made.items() if here.get(key) != mark]
    if changes:
        raise ResultsError(f"node {node} of the cluster has another Thalweg ({'; '.join(changes)})")
