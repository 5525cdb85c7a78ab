"""Terminal output that survives a closed terminal: status lines, progress bars, signals."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from haptigraph.recording.writer import Progress

__all__ = ["print_status", "progress_bar", "terminable"]


def print_status(text: str) -> None:
    """Print a status line to standard error, if it is still open."""
    with suppress(OSError):
        click.echo(text, err=True)


@contextmanager
def terminable() -> Iterator[None]:
    """Make SIGTERM and a closed terminal end a run like Ctrl-C: vibration stops, the recording is closed."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    endings = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    handled = [number for number in endings if signal.getsignal(number) is not signal.SIG_IGN]  # as by nohup
    before = {number: signal.signal(number, interrupt) for number in handled}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def progress_bar() -> Iterator["Progress"]:
    """Show a progress bar in a terminal, from the first report of progress on."""
    from rich.console import Console
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    bar = Bar(console=console, transient=True, disable=not console.is_terminal)
    tasks: dict[str, Any] = {}

    def report(what: str, done: int, total: int) -> None:
        with suppress(OSError):  # the work continues if the terminal closes
            bar.start()
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=total)
            bar.update(tasks[what], completed=done)

    try:
        yield report
    finally:
        with suppress(OSError):
            bar.stop()
