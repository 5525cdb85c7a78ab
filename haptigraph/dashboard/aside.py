"""Do what takes seconds in a process of its own, so that a loop beside it keeps its time.

Knows not what the work is.
"""

import os
import signal
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from haptigraph.errors import BadInput, HaptigraphError

__all__ = ["aside"]

T = TypeVar("T")
NICE = 5


def aside(work: Callable[..., T], *given: Any, progress: Callable[[str], None]) -> T:
    """Call a function in a new process and wait for what it returns.

    Args:
        work: A function of a module; it gets what is given, and a function to tell its progress.
        given: What it needs; copied.
        progress: Told how far it is.

    Raises:
        BadInput: As the work does.
        HaptigraphError: If it fails otherwise; its traceback is in the terminal.
    """
    context = get_context("spawn")  # a fork would share the server's socket and the loop's locks
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(there, work, given), daemon=True)
    process.start()
    there.close()
    try:
        while True:
            kind, told = here.recv()
            if kind == "done":
                return told  # type: ignore[no-any-return]
            if kind == "refused":
                raise BadInput(*told)
            progress(told)
    except EOFError:
        process.join()
        raise HaptigraphError(
            f"it ended too early, with exit code {process.exitcode}; the terminal may say why"
        ) from None
    finally:
        here.close()


def _work(there: Connection, work: Callable[..., Any], given: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program that waits; it ends this one
    if hasattr(os, "nice"):
        os.nice(NICE)
    try:
        there.send(("done", work(*given, lambda what: there.send(("progress", what)))))
    except BadInput as error:
        there.send(("refused", (error.problem, error.file, error.place)))
    except BrokenPipeError:
        pass  # nobody waits any more
