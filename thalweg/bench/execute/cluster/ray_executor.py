"""Executor for the runs of a suite on a Ray cluster, one task per run.

Nodes need no shared disk. A run is sent to a node with all its files so far, and its files come back from time to time;
if its node is lost, the run resumes on another one from there. Everything is collected in the one results folder, so
that the same command resumes after any interruption, on the cluster or without one. Ray is imported only when it is
needed.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.backend import installed_versions
from thalweg.bench.execute.cluster.connection import check_address, check_ray, ray_connection
from thalweg.bench.execute.cluster.node_task import RunRequest, RunUpdate
from thalweg.bench.execute.cluster.run_archive import milestones, pack, unpack
from thalweg.bench.execute.executors import THREAD_VARIABLES, ExecutionContext, execute_run, print_row, run_row
from thalweg.bench.execute.river_files import OtherRiverError, require_unchanged, river_contents
from thalweg.bench.results.results import RunRow
from thalweg.bench.results.run_versions import current_sources
from thalweg.bench.suite.arms import Run
from thalweg.core.plugins.lookup import file_contents

MAX_ATTEMPTS = 3
"""Attempts at a run without progress between them; then it has failed."""
FLOWN = ("function", "policy")
"""Kinds of runs that only fly what is in files of this machine."""
SYNC_INTERVAL_S, WAIT_NOTICE_S = 300.0, 60.0
"""Shortest interval between two transfers of a run's files, and seconds without any progress before a notice."""


@dataclass
class _RunState:
    """A run that waits for a node or is executed by one."""

    run: Run
    node: str = ""
    """Name of the machine that executes it; empty while it waits."""
    reached: frozenset[str] = frozenset()
    """Milestones that have come back."""
    interruptions: int = 0
    """Interruptions since the last new milestone."""


class RayExecutor:
    """Executes as many runs at a time as the cluster has processors for, or at most `jobs`."""

    def __init__(
        self, address: str, jobs: int | None = None, cpus: int = 1, sync_interval_s: float = SYNC_INTERVAL_S
    ) -> None:
        """Raises `ResultsError` for an address of an unsupported kind, and if Ray is not installed.

        Args:
            address: `auto` for the cluster that this machine is a node of, or the head's address, `HOST:PORT`.
            jobs: Maximum number of runs at a time.
            cpus: Processors, and threads, of each run.
            sync_interval_s: Shortest interval between two transfers of a run's files.
        """
        for name, number in (("jobs", jobs), ("cpus", cpus)):
            if number is not None and number < 1:
                raise ResultsError(f"{name} must be at least 1, not {number}")
        check_address(address)
        check_ray()
        self.address, self.jobs, self.cpus, self.sync_interval_s = address, jobs, cpus, sync_interval_s

    def execute(self, context: ExecutionContext, runs: Sequence[Run]) -> Iterator[RunRow]:
        """See `Executor`; functions and policies of files fly on this machine.

        Raises `ResultsError` for a cluster that cannot be joined or has a node with other versions, and `OSError` for a
        full disk on this machine. All runs end then.
        """
        for run in runs:
            if run.kind in FLOWN:  # their files are here
                yield execute_run(run, context)
        pending = [_RunState(run) for run in runs if run.kind not in FLOWN]
        active = dict[Any, _RunState]()
        if not pending:
            return
        with ray_connection(self.address) as ray:
            submit, noticed = self._task(ray), False
            while pending or active:
                while pending and len(active) < (self.jobs or len(runs)):
                    state = pending.pop(0)
                    active[submit(self._request(ray, state, context))] = state
                ready, _ = ray.wait(list(active), timeout=WAIT_NOTICE_S)
                if not ready and not noticed and not any(state.node for state in active.values()):
                    self._print_missing_processors(ray, context)
                    noticed = True
                for stream in ready:
                    state = active.pop(stream)
                    row = _process_update(ray, stream, state, context)
                    if row is not None:
                        print_row(context.console, row)
                        yield row
                    elif state.node:
                        active[stream] = state
                    else:
                        pending.insert(0, state)

    def _task(self, ray: Any) -> Callable[[bytes], Any]:
        """Return a function that submits a request to a node and returns the stream of its updates."""
        return ray.remote(
            num_cpus=self.cpus,
            max_calls=1,  # a new process for each run
            max_retries=0,  # the executor itself restarts a run, from its newest files
            scheduling_strategy="SPREAD",
            runtime_env={"env_vars": dict.fromkeys(THREAD_VARIABLES, str(self.cpus))},
        )(_node_function()).remote

    def _request(self, ray: Any, state: _RunState, context: ExecutionContext) -> bytes:
        """Return the pickled request for a run."""
        files = pack(context.folder, state.run.name, context.suite.trials(state.run))
        state.reached |= milestones(files)
        require_unchanged(context.suite, context.folder)
        request = RunRequest(
            state.run,
            context.suite,
            context.backend,
            files,
            installed_versions(),
            self.sync_interval_s,
            file_contents(),
            current_sources(context.suite.plugins_of(state.run)),
            river_contents(context.suite),
        )
        return ray.cloudpickle.dumps(request)

    def _print_missing_processors(self, ray: Any, context: ExecutionContext) -> None:
        largest = max((node["Resources"].get("CPU", 0) for node in ray.nodes() if node["Alive"]), default=0)
        context.console.print(
            f"waiting for a node with free processors: a run takes {self.cpus}, the largest node has {largest:.0f}",
            highlight=False,
        )


def _node_function() -> Callable[[bytes], Iterator[Any]]:
    """Return the function that Ray executes on a node: `run_on_node`, or an error that names a node without Thalweg.

    Ray sends a nested function by value; one at module level would have to exist on the node.
    """

    def on_node(request: bytes) -> Iterator[Any]:
        import pickle
        import socket

        try:
            from thalweg.bench.execute.cluster.node_task import run_on_node
        except ImportError as error:
            raise ImportError(f"node {socket.gethostname()} of the cluster lacks this Thalweg ({error})") from error
        yield from run_on_node(pickle.loads(request))

    return on_node


def _process_update(ray: Any, stream: Any, state: _RunState, context: ExecutionContext) -> RunRow | None:
    """Store the next update of a run; returns its row if it has ended, else None.

    A run that is to be restarted has no node afterwards.
    """
    try:
        update: RunUpdate = ray.get(next(stream))
    except ray.exceptions.RayTaskError as error:
        return _failed_row(error.cause, state, context)
    except (ray.exceptions.RayError, StopIteration) as error:
        return _handle_interruption(error, state, context)
    if not state.node:
        state.node = update.node
        context.console.print(f"{state.run.name}: started on {state.node}", highlight=False)
    if update.files is not None:
        unpack(update.files, context.folder, state.run.name)
        if not milestones(update.files) <= state.reached:
            state.reached, state.interruptions = state.reached | milestones(update.files), 0
    return update.row


def _failed_row(cause: BaseException, state: _RunState, context: ExecutionContext) -> RunRow:
    """Return the row of a run that failed with an error on its node; raises an error that concerns all nodes."""
    if isinstance(cause, OtherRiverError):
        raise ResultsError(str(cause)) from cause
    if isinstance(cause, ResultsError | ImportError):
        raise ResultsError(f"{cause}; install the same Thalweg on every node") from cause
    error = f"{type(cause).__name__}: {cause} (on {state.node or 'a node'})"
    return run_row(state.run, context, " ".join(error.split()))


def _handle_interruption(error: Exception, state: _RunState, context: ExecutionContext) -> RunRow | None:
    """Free the run of its node; returns its row if it was interrupted too often, otherwise None."""
    kind = type(error).__name__
    reasons = {"NodeDiedError": "{} was lost", "OutOfMemoryError": "{} ran out of memory"}
    reason = reasons.get(kind, f"the process that did it on {{}} ended ({kind})").format(state.node or "a node")
    state.interruptions += 1
    state.node = ""
    if state.interruptions >= MAX_ATTEMPTS:
        return run_row(state.run, context, f"{reason}; {MAX_ATTEMPTS} times without progress")
    context.console.print(f"{state.run.name}: {reason}; it is restarted", highlight=False, markup=False)
    return None
