"""What takes seconds or longer, in a process of its own: read, replay, measure and export runs; find an eye.

`python -m haptigraph.dashboard.jobs.main JOB FOLDER` does one job in a folder. What it is about comes pickled
on stdin; it answers on stdout in frames (`frames.py`), the last of which may tell a problem. Knows nothing of
HTTP. A process, not a thread, so that a loop beside it keeps its interpreter; it asks for little, and ends
with its parent.
"""

import os
import pickle
import sys
import threading
from contextlib import suppress
from importlib import import_module

import cv2
import msgspec

from haptigraph.dashboard.server.frames import put_frame
from haptigraph.errors import HaptigraphError

__all__ = ["JOBS", "main"]

JOBS = {
    "timeline": ("haptigraph.dashboard.jobs.read:read_run", 15),
    "outcomes": ("haptigraph.dashboard.jobs.read:outcomes", 15),
    "compare": ("haptigraph.dashboard.jobs.compare:compare", 15),
    "csv": ("haptigraph.dashboard.jobs.export:export_csv", 15),
    "png": ("haptigraph.dashboard.jobs.draw:export_png", 15),
    "register": ("haptigraph.dashboard.jobs.register:look_at", 5),  # no run without it
}
"""What does them, imported when asked for (drawing alone takes seconds to load), and how nice it is."""


def main() -> None:
    """Do one job and answer on stdout."""
    job, folder = sys.argv[1:]
    given = pickle.load(sys.stdin.buffer)
    path, nice = JOBS[job]
    _ask_for_little(nice)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        os.chdir(folder)
        module, _, name = path.partition(":")
        getattr(import_module(module), name)(*given)
    except HaptigraphError as error:
        _problem(str(error))
    except msgspec.MsgspecError as error:
        _problem(f"{given[0]}: its settings cannot be read ({error})")
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _problem(f"{where}{error.strerror or error}")


def _problem(sentence: str) -> None:
    put_frame({"type": "problem", "problem": sentence})


def _ask_for_little(nice: int) -> None:
    cv2.setNumThreads(1)
    if hasattr(os, "nice"):
        with suppress(OSError):
            os.nice(nice)


def _end_with_parent() -> None:
    """End when the other side of stdin has gone, however it went."""
    while os.read(sys.stdin.fileno(), 1):
        continue
    os._exit(1)


if __name__ == "__main__":
    main()
