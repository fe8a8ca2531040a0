"""Task of a cluster's node: one run in a temporary folder, whose files are sent back.

This module does not import Ray. The run is executed by a thread, while the caller receives updates.
"""

import socket
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.backend import Backend, installed_versions
from thalweg.bench.execute.cluster.run_archive import Files, archive_names, milestones, pack, unpack
from thalweg.bench.execute.executors import execute_run_logged
from thalweg.bench.execute.river_files import Place, require_same_on_node
from thalweg.bench.results.results import RunRow
from thalweg.bench.results.run_versions import current_sources
from thalweg.bench.suite.arms import Run
from thalweg.bench.suite.config import Suite
from thalweg.core.atomic_io import write_atomic
from thalweg.core.plugins.lookup import add_files

POLL_S = 0.5
"""Interval at which the run's thread is checked."""


@dataclass(frozen=True)
class RunRequest:
    """A run to execute, and its files so far."""

    run: Run
    suite: Suite
    backend: Backend
    files: Files
    """Files of the run so far, see `thalweg.bench.execute.cluster.run_archive`."""
    versions: Mapping[str, int | None]
    """`installed_versions` of the machine where the results are collected."""
    sync_interval_s: float
    """Shortest interval between two updates with files."""
    plugins: Sequence[tuple[str, Mapping[str, bytes]]] = ()
    """Files of plug-ins to load, each by its name, with the modules beside it that it imports, by relative paths."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """Hashes of the sources of the plug-ins of the run, where the results are collected."""
    rivers: Mapping[Place, str] = field(default_factory=dict)
    """Hashes of the files of the suite's real rivers, where the results are collected."""


@dataclass(frozen=True)
class RunUpdate:
    """The state of a run on a node."""

    node: str
    """Name of the machine."""
    files: Files | None = None
    """All files of the run; None if there is nothing new."""
    row: RunRow | None = None
    """The run's row, once it has ended."""


def run_on_node(request: RunRequest) -> Iterator[RunUpdate]:
    """Execute a run; yields an update at its start, while it makes progress, and at its end.

    Raises `ResultsError` if this machine has other versions, another file of a river or of the policy that the run
    begins with, and `OSError` if its disk is full.
    """
    node = socket.gethostname()
    _require_same_versions(request.versions, node)
    require_same_on_node(request.suite, request.rivers, node)
    _require_begun(request, node)
    yield RunUpdate(node)
    with (
        tempfile.TemporaryDirectory(prefix="thalweg-", ignore_cleanup_errors=True) as name,
        tempfile.TemporaryDirectory(prefix="thalweg-plugins-", ignore_cleanup_errors=True) as plugins,
    ):
        _load_plugins(request, Path(plugins), node)
        archive = Path(name), request.run.name, request.suite.trials(request.run)
        unpack(request.files, Path(name), request.run.name)
        sent, sent_at = milestones(request.files), time.monotonic()
        thread = _RunThread(request, Path(name))
        while not thread.has_ended():
            if time.monotonic() - sent_at < request.sync_interval_s:
                continue
            # The run may remove a file while it is listed or packed; the next check finds the one that replaced it.
            with suppress(FileNotFoundError):
                if milestones(archive_names(*archive)) == sent:
                    continue
                files = pack(*archive)
                sent, sent_at = milestones(files), time.monotonic()
                yield RunUpdate(node, files)
        row = thread.row()
        yield RunUpdate(node, pack(*archive), row)


def _require_begun(request: RunRequest, node: str) -> None:
    """Raise `ResultsError` unless the policy that the run begins with, if any, is that of where results are
    collected."""
    begun = request.suite.arm(request.run.algorithm).begin_with if request.run.kind == "train" else None
    if begun is None:
        return
    if (found := begun.content_now) != begun.content:
        raise ResultsError(
            f"node {node} of the cluster has another policy {begun.given} (its content: {found or 'no file'} there,"
            f" {begun.content} here); copy the file to every node"
        )


class _RunThread:
    """A thread that executes a run."""

    def __init__(self, request: RunRequest, folder: Path) -> None:
        self._outcome: RunRow | BaseException | None = None
        self._thread = threading.Thread(target=self._execute, args=(request, folder), daemon=True)
        self._thread.start()

    def has_ended(self) -> bool:
        """Wait for at most `POLL_S`, and return whether the run has ended."""
        self._thread.join(POLL_S)
        return not self._thread.is_alive()

    def row(self) -> RunRow:
        """Return the row of the run, which has ended; raises the error that ended it."""
        if isinstance(self._outcome, RunRow):
            return self._outcome
        raise self._outcome or RuntimeError("the run has not ended")

    def _execute(self, request: RunRequest, folder: Path) -> None:
        try:
            self._outcome = execute_run_logged(request.run, request.suite, folder, request.backend)
        except BaseException as error:
            self._outcome = error


def _load_plugins(request: RunRequest, folder: Path, node: str) -> None:
    """Write the files of plug-ins to a folder and use them; raises `ResultsError` unless those of the run are the same
    here."""
    for number, (_, files) in enumerate(request.plugins):
        for name, content in files.items():
            write_atomic(folder / str(number) / name, content)
    add_files(folder / str(number) / name for number, (name, _) in enumerate(request.plugins))
    for name, source in request.sources.items():
        found = current_sources([name]).get(name)
        if found != source:
            raise ResultsError(
                f"node {node} of the cluster has another plug-in {name} (its source: {found or 'none'} there, {source}"
                " here)"
            )


def _require_same_versions(expected: Mapping[str, int | None], node: str) -> None:
    """Raise `ResultsError` that names each version in which this machine differs."""
    installed = installed_versions()
    changes = [
        f"{name} {installed.get(name)} there, {version} here"
        for name, version in expected.items()
        if installed.get(name) != version
    ]
    if changes:
        raise ResultsError(f"node {node} of the cluster has another Thalweg ({'; '.join(changes)})")
