"""Run a function on many tasks in processes of this machine.

Each process works on one task at a time, so that it is known which task it died of.
"""

import signal
from collections.abc import Callable, Generator, Iterable
from contextlib import suppress
from itertools import islice
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar

from haptigraph.errors import HaptigraphError
from haptigraph.spreading.tasks import ATTEMPTS, Killed

__all__ = ["in_processes"]

Task = TypeVar("Task")
Result = TypeVar("Result")
SPAWN = get_context("spawn")  # a fork would copy threads and locks in an unknown state
END_TIMEOUT_S = 5
MAX_FAILED_STARTS = 50


def in_processes(
    work: Callable[[Task], Result], tasks: Iterable[Task], workers: int
) -> Generator[tuple[Task, Result | Killed], None, None]:
    """Yield every task with its result, in the order of completion; an exception of `work` is raised.

    Args:
        work: A function that can be imported.
        tasks: Must be picklable; consumed on demand.
        workers: Number of processes.

    Raises:
        HaptigraphError: If processes die again and again before they have taken a task.
    """
    waiting, busy, failed_starts = iter(tasks), dict[Any, _Worker](), 0
    try:
        for task in islice(waiting, workers):
            _begin(busy, _Worker(work), task)
        while busy:
            for connection in wait(list(busy)):
                worker = busy[connection]
                task, was_ready, answer = worker.task, worker.is_ready, worker.answer()
                if worker.is_ready and not was_ready:
                    failed_starts = 0
                    continue
                del busy[connection]
                failed_starts += not was_ready
                _check_starts(failed_starts)
                if answer is None and worker.attempts - (not was_ready) < ATTEMPTS:
                    _begin(busy, _Worker(work, worker.attempts - (not was_ready)), task)
                    continue
                for following in islice(waiting, 1):
                    _begin(busy, worker if answer else _Worker(work), following)
                if worker.connection not in busy:
                    worker.end()
                yield task, Killed() if answer is None else _result(answer)
    finally:
        for worker in busy.values():
            worker.end()


class _Worker:
    """A process, the task that it works on, and how many workers have tried this task."""

    def __init__(self, work: Callable[[Any], Any], attempts: int = 0) -> None:
        self.connection, theirs = SPAWN.Pipe()
        self.task: Any = None
        self.attempts = attempts
        self.is_ready = False
        """Whether it has started; if it dies before, its task is not the reason."""
        self._process = SPAWN.Process(target=_serve, args=(theirs, work), daemon=True)
        self._process.start()
        theirs.close()  # so that the end of the process ends the connection

    def answer(self) -> tuple[Any, Exception | None] | None:
        """Return result and exception of the task; None if the process is just ready, or has died."""
        try:
            answer: tuple[Any, Exception | None] | None = self.connection.recv()
        except (EOFError, OSError):
            self.end()
            return None
        self.is_ready = True
        self.attempts = self.attempts if answer is None else 0
        return answer

    def end(self) -> None:
        """End the process. May be called twice."""
        if self.connection.closed:
            return
        self.connection.close()
        self._process.terminate()
        self._process.join(END_TIMEOUT_S)
        if self._process.exitcode is None:
            self._process.kill()
            self._process.join()
        self._process.close()


def _begin(busy: dict[Any, _Worker], worker: _Worker, task: object) -> None:
    busy[worker.connection] = worker
    worker.task = task
    worker.attempts += 1
    with suppress(OSError):  # it has died; its answer says so
        worker.connection.send(task)


def _check_starts(failed: int) -> None:
    if failed >= MAX_FAILED_STARTS:
        raise HaptigraphError(f"{failed} worker processes in a row died before they took a task")


def _result(answer: tuple[Any, Exception | None]) -> Any:
    result, error = answer
    if error is not None:
        raise error
    return result


def _serve(connection: Connection, work: Callable[[Any], Any]) -> None:
    """Work on tasks until the other end of the connection is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process ends its workers
    with suppress(EOFError, OSError):
        connection.send(None)  # ready
        while True:
            task = connection.recv()
            try:
                answer: tuple[Any, Exception | None] = work(task), None
            except Exception as error:
                answer = None, error
            connection.send(answer)
