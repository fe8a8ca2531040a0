"""Who does the runs of a suite on many machines? A cluster of Ray's, one task for each run.

Nodes need no common disk: a run goes to a node with all that there is of it, comes back from time to time as far as it
is, and goes on elsewhere from there if its node is lost. Everything is gathered in the one folder of results, so that
the same command goes on after any interruption, here or on a cluster. Ray is imported only when it is asked for.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.cluster.connection import check_address, import_ray, joined
from thalweg.bench.execute.cluster.node_task import News, Order
from thalweg.bench.execute.cluster.run_archive import milestones, pack, unpack
from thalweg.bench.execute.executors import Work, row_of
from thalweg.bench.execute.rivers import made_by
from thalweg.bench.results.results import RunRow
from thalweg.bench.suite.suites import Run

TRIES = 3
"""How often a run that broke off is begun again without having got further than before; then it has failed."""
GATHER_S, PATIENCE_S = 300.0, 60.0
"""Least time between two parcels of a run, and how long nothing may happen before it is said what is waited for."""


@dataclass
class _Going:
    """A run that is waiting for a node or being done by one."""

    run: Run
    node: str = ""
    """The name of the machine that does it."""
    reached: frozenset[str] = frozenset()
    """Milestones that came back."""
    broken_off: int = 0
    """How often it broke off since the last new one."""


class Cluster:
    """The nodes of a cluster, as many runs at a time as they have processors for, or at most `jobs`."""

    def __init__(self, address: str, jobs: int | None = None, cpus: int = 1, gather_s: float = GATHER_S) -> None:
        """Raises `ResultsError` for an address of a kind that is not taken, or where Ray is not installed.

        Args:
            address: `auto`, the cluster that this machine is a node of, or its head's address, `HOST:PORT`.
            jobs: How many runs at a time.
            cpus: How many processors each run takes; it computes in as many threads.
            gather_s: Least time between two parcels of a run.
        """
        for name, number in (("jobs", jobs), ("cpus", cpus)):
            if number is not None and number < 1:
                raise ResultsError(f"{name} must be at least 1, not {number}")
        check_address(address)
        import_ray()
        self.address, self.jobs, self.cpus, self.gather_s = address, jobs, cpus, gather_s

    def carry_out(self, work: Work, runs: Sequence[Run]) -> Iterator[RunRow]:
        """See `Hands`; raises `ResultsError` for a cluster that can't be joined or has a node with another Thalweg, and
        `OSError` for a full disk here. All runs end then."""
        waiting, going = [_Going(run) for run in runs], dict[Any, _Going]()
        if not waiting:
            return
        with joined(self.address) as ray:
            task, told = self._task(ray), False
            while waiting or going:
                while waiting and len(going) < (self.jobs or len(runs)):
                    begun = waiting.pop(0)
                    going[task(self._order(ray, begun, work))] = begun
                ready, _ = ray.wait(list(going), timeout=PATIENCE_S)
                if not ready and not told and not any(one.node for one in going.values()):
                    told = self._say_what_is_missing(ray, work)
                for stream in ready:
                    one = going.pop(stream)
                    row = _heard(ray, stream, one, work)
                    if row is not None:
                        work.console.print(
                            f"{row.run}: {row.status} {row.error}".rstrip(), highlight=False, markup=False
                        )
                        yield row
                    elif one.node:
                        going[stream] = one
                    else:
                        waiting.insert(0, one)

    def _task(self, ray: Any) -> Callable[[bytes], Any]:
        """What sends an order to a node, and returns the stream of its news."""
        threads = {name: str(self.cpus) for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")}
        return ray.remote(
            num_cpus=self.cpus,
            max_calls=1,  # a process of its own for each run, as here
            max_retries=0,  # it is we who begin a run again, from where it was
            scheduling_strategy="SPREAD",
            runtime_env={"env_vars": threads},
        )(_for_nodes()).remote

    def _order(self, ray: Any, one: _Going, work: Work) -> bytes:
        """What a node is to do, for `_for_nodes`."""
        files = pack(work.folder, one.run.name, work.suite.trials(one.run))
        one.reached |= milestones(files)
        return ray.cloudpickle.dumps(Order(one.run, work.suite, work.place, files, made_by(), self.gather_s))

    def _say_what_is_missing(self, ray: Any, work: Work) -> bool:
        has = max((node["Resources"].get("CPU", 0) for node in ray.nodes() if node["Alive"]), default=0)
        work.console.print(
            f"waiting for a node with free processors: a run takes {self.cpus}, the largest node has {has:.0f}",
            highlight=False,
        )
        return True


def _for_nodes() -> Callable[[bytes], Iterator[Any]]:
    """What Ray runs on a node: `errand`, or an error that names a node without it.

    Ray sends a function that stands inside another as it is; one that stands in a module must be there already.
    """

    def on_node(order: bytes) -> Iterator[Any]:
        import pickle
        import socket

        try:
            from thalweg.bench.execute.cluster.node_task import errand
        except ImportError as error:
            raise ImportError(f"node {socket.gethostname()} of the cluster lacks this Thalweg ({error})") from error
        yield from errand(pickle.loads(order))

    return on_node


def _heard(ray: Any, stream: Any, one: _Going, work: Work) -> RunRow | None:
    """The row of a run that is over; None for one that goes on, without a node if it is to be begun again."""
    try:
        news: News = ray.get(next(stream))
    except ray.exceptions.RayTaskError as error:
        return _refused(error.cause, one, work)
    except (ray.exceptions.RayError, StopIteration) as error:
        return _broken_off(error, one, work)
    if not one.node:
        one.node = news.node
        work.console.print(f"{one.run.name}: begun on {one.node}", highlight=False)
    if news.files is not None:
        unpack(news.files, work.folder, one.run.name)
        if not milestones(news.files) <= one.reached:
            one.reached, one.broken_off = one.reached | milestones(news.files), 0
    return news.row


def _refused(cause: BaseException, one: _Going, work: Work) -> RunRow:
    """The row of a run that an error on its node kept from being done; raises what all nodes must mend."""
    if isinstance(cause, ResultsError | ImportError):
        raise ResultsError(f"{cause}; install the same Thalweg on every node") from cause
    return row_of(one.run, work, " ".join(f"{type(cause).__name__}: {cause} (on {one.node or 'a node'})".split()))


def _broken_off(error: Exception, one: _Going, work: Work) -> RunRow | None:
    """The row of a run that broke off too often; else none, and its node is forgotten."""
    kind = type(error).__name__
    whys = {"NodeDiedError": "{} was lost", "OutOfMemoryError": "{} ran out of memory"}
    why = whys.get(kind, f"the process that did it on {{}} ended ({kind})").format(one.node or "a node")
    one.broken_off += 1
    one.node = ""
    if one.broken_off >= TRIES:
        return row_of(one.run, work, f"{why}; {TRIES} times without getting further")
    work.console.print(f"{one.run.name}: {why}; it is begun again", highlight=False, markup=False)
    return None
