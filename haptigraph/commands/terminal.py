"""Terminal output that survives a closed terminal: status, pages, progress bars, signals."""

import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

    from haptigraph.dashboard.live.live import LivePage
    from haptigraph.recording.writer import Progress

__all__ = ["can_open_browser", "print_status", "progress_bar", "show_page", "terminable"]

OPENER = "haptigraph-browser"
SSH = ("SSH_CONNECTION", "SSH_TTY")
LINE_S = 10.0
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")


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
    """Show a progress bar in a terminal, or else print a line now and then; nothing without reports."""
    if not sys.stderr.isatty():
        yield _progress_lines()
        return
    bar = cache(_bar)  # which takes long to load, and most runs report no progress
    tasks: dict[str, Any] = {}

    def report(what: str, done: int, total: int) -> None:
        with suppress(OSError):  # the work continues if the terminal closes
            bar().start()
            if what not in tasks:
                tasks[what] = bar().add_task(what, total=total)
            bar().update(tasks[what], completed=done)

    try:
        yield report
    finally:
        with suppress(OSError):
            if bar.cache_info().currsize:
                bar().stop()


def _progress_lines() -> "Progress":
    """Return a report of progress that prints a line every `LINE_S` of work."""
    printed_s: dict[str, float] = {}

    def report(what: str, done: int, total: int) -> None:
        now_s = time.monotonic()
        if now_s - printed_s.setdefault(what, now_s) >= LINE_S:
            printed_s[what] = now_s
            print_status(f"{what}: {done} of {total}")

    return report


def _bar() -> "Bar":
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    return Progress(console=console, transient=True, disable=not console.is_terminal)


def can_open_browser() -> bool:
    """Return whether a person sits at this machine: at a terminal, with a display, not over SSH."""
    if not sys.stderr.isatty() or any(os.environ.get(name) for name in SSH):
        return False
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in DISPLAYS)


def show_page(page: "LivePage", *, opens: bool) -> None:
    """Print a page's addresses and QR codes, and open it.

    Args:
        page: The page.
        opens: Whether the user wants the browser to open.
    """
    for line in page.address_lines:
        print_status(line)
    for role, code in page.qr_codes if sys.stderr.isatty() else ():
        print_status(f"\nscan to {role}\n{code}")
    if opens and can_open_browser():
        import threading
        import webbrowser

        # In a thread: some browsers return only when they are closed.
        threading.Thread(target=webbrowser.open, args=(page.address,), name=OPENER, daemon=True).start()
