"""Run a function on many tasks in processes of this machine.

Each process works on one task at a time, so that it is known which task it died of.
"""

import signal
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from itertools import count
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar

from haptigraph.spreading.tasks import ATTEMPTS, Killed

__all__ = ["in_processes"]

Task = TypeVar("Task")
Result = TypeVar("Result")
SPAWN = get_context("spawn")  # a fork would copy threads and locks in an unknown state
END_TIMEOUT_S = 5


class _Worker:
    def __init__(self, work: Callable[[Any], Any]) -> None:
        self.connection, theirs = SPAWN.Pipe()
        self._process = SPAWN.Process(target=_serve, args=(theirs, work), daemon=True)
        self._process.start()
        theirs.close()  # so that the end of the process ends the connection

    def send(self, task: object) -> None:
        with suppress(OSError):  # it has died; reading from it says so
            self.connection.send(task)

    def end(self) -> None:
        self.connection.close()
        self._process.terminate()
        self._process.join(END_TIMEOUT_S)
        if self._process.exitcode is None:
            self._process.kill()
            self._process.join()
        self._process.close()


def in_processes(
    work: Callable[[Task], Result], tasks: Iterable[Task], workers: int
) -> Iterator[tuple[Task, Result | Killed]]:
    """Yield every task with its result, in the order of completion; an exception of `work` is raised.

    Args:
        work: A function that can be imported.
        tasks: Must be picklable; consumed on demand.
        workers: Number of processes.
    """
    waiting, numbers = iter(tasks), count()
    busy: dict[Connection, tuple[_Worker, int, Task]] = {}
    deaths: Counter[int] = Counter()

    def begin(worker: _Worker | None) -> None:
        """Give the next task to a worker, or to a new one; without a task, end it."""
        for task in waiting:
            worker = worker or _Worker(work)
            busy[worker.connection] = worker, next(numbers), task
            worker.send(task)
            return
        if worker is not None:
            worker.end()

    try:
        for _ in range(workers):
            begin(None)
        while busy:
            for connection in wait(list(busy)):
                worker, number, task = busy.pop(connection)  # type: ignore[index]
                try:
                    result, error = worker.connection.recv()
                except (EOFError, OSError):
                    worker.end()
                    deaths[number] += 1
                    if deaths[number] < ATTEMPTS:
                        again = _Worker(work)
                        busy[again.connection] = again, number, task
                        again.send(task)
                        continue
                    begin(None)
                    yield task, Killed()
                    continue
                deaths.pop(number, None)
                begin(worker)
                if error is not None:
                    raise error
                yield task, result
    finally:
        for worker, _, _ in busy.values():
            worker.end()


def _serve(connection: Connection, work: Callable[[Any], Any]) -> None:
    """Work on tasks until the other end of the connection is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process ends its workers
    with suppress(EOFError, OSError):
        while True:
            task = connection.recv()
            try:
                answer: tuple[Any, BaseException | None] = work(task), None
            except Exception as error:
                answer = None, error
            connection.send(answer)
