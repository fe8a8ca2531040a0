"""`Worker`: one thread that does what it is asked for, in order, and holds up nobody's exit."""

import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Generic, TypeVar
from weakref import WeakMethod

T = TypeVar("T")


class Worker(Generic[T]):
    """Calls a method in a thread. `ThreadPoolExecutor` would finish all that is waiting before Python may end."""

    def __init__(self, work: "WeakMethod[Callable[[int], T]]", name: str) -> None:
        """`work` does not keep its object alive; once that is gone, the thread ends."""
        self._work = work
        self._queue: SimpleQueue[tuple[Future[T], int] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether the thread runs; it does not in a forked process."""
        return self._thread.is_alive()

    def submit(self, number: int) -> "Future[T]":
        """Return the future result of the function for a number."""
        future: Future[T] = Future()
        self._queue.put((future, number))
        return future

    def close(self) -> None:
        """Wait for the call that is running; those that wait must have been cancelled."""
        self.end()
        self._thread.join()

    def end(self) -> None:
        """Let the thread end after the calls that it was asked for."""
        self._queue.put(None)

    def _run(self) -> None:
        while (asked := self._queue.get()) is not None:
            self._do(*asked)
            del asked  # a future holds its error, whose traceback holds the method's object

    def _do(self, future: "Future[T]", number: int) -> None:
        if not future.set_running_or_notify_cancel():
            return
        try:
            result = self._call(number)
        except BaseException as error:
            future.set_exception(error)
        else:
            future.set_result(result)

    def _call(self, number: int) -> T:
        """Return the result for a number. Only as long as this takes, the thread keeps the method's object alive."""
        if (work := self._work()) is None:
            raise ReferenceError("the object whose method was to be called is gone")
        return work(number)
