"""Processes of our own that hold hardware: how they are started, and which signals they obey.

Such a process ends with its standard input: when its parent closes it, or dies, even by kill -9.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import IO, Any

__all__ = ["child_environment", "obey_sigterm_only", "pipe_of", "program_of", "raise_priority", "start_child"]

PRIORITY = 10


def program_of(module: str) -> list[str]:
    """Return the command that runs a module of ours."""
    return [sys.executable, "-P", "-m", module]


def child_environment() -> dict[str, str]:
    """Return the environment of a child that imports from where this process does."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)}


def start_child(command: Sequence[str]) -> "subprocess.Popen[bytes]":
    """Start a program with unbuffered pipes, in a session of its own, with this process's import paths.

    In its own session it survives Ctrl-C and a kill of the run's process group.

    Raises:
        OSError: If it cannot be started.
    """
    return subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        bufsize=0,
        env=child_environment(),
        start_new_session=True,
    )


def pipe_of(pipe: IO[bytes] | None) -> IO[bytes]:
    """Return a pipe of a process that `start_child` started."""
    if pipe is None:
        raise ValueError("the process has no pipe")
    return pipe


def obey_sigterm_only(end: Callable[[], Any]) -> None:
    """Ignore Ctrl-C and a closed terminal, and call a function on SIGTERM."""
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: end())


def raise_priority() -> None:
    """Ask the system to schedule this process before others, where it may."""
    with suppress(AttributeError, OSError):  # Linux, with the permission
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
