"""What all commands share of a terminal that may go away: words beside the output, progress, signals."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from haptigraph.recording.writer import Progress

__all__ = ["progress_bar", "tell", "terminable"]


def tell(text: str) -> None:
    """Say something beside the output, where there still is someone to hear it."""
    with suppress(OSError):
        click.echo(text, err=True)


@contextmanager
def terminable() -> Iterator[None]:
    """Let SIGTERM and a closed terminal end a run like Ctrl-C: the hand is stilled, the recording closed."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    endings = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    ours = [number for number in endings if signal.getsignal(number) is not signal.SIG_IGN]  # as under nohup
    before = {number: signal.signal(number, interrupt) for number in ours}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def progress_bar() -> Iterator["Progress"]:
    """Show a bar for work that reports its progress, from its first report on, where someone is looking."""
    from rich.console import Console
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    bar = Bar(console=console, transient=True, disable=not console.is_terminal)
    tasks: dict[str, Any] = {}

    def report(what: str, done: int, total: int) -> None:
        with suppress(OSError):  # the terminal may go away; the work goes on
            bar.start()
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=total)
            bar.update(tasks[what], completed=done)

    try:
        yield report
    finally:
        with suppress(OSError):
            bar.stop()
