"""Run one job in a process of its own: read, replay, measure and export runs; find an eye.

`python -m haptigraph.dashboard.jobs.main JOB FOLDER` runs a job in a folder. Its arguments come pickled on
stdin; its answer goes to stdout as a stream of messages (`server/stream.py`), of which the last may report a
problem. A process rather than a thread, so that a loop beside it keeps the interpreter to itself. It runs
with low priority and ends with its parent.
"""

import os
import pickle
import sys
import threading
from contextlib import suppress

import cv2
import msgspec

from haptigraph.dashboard.server.stream import send_message
from haptigraph.errors import HaptigraphError
from haptigraph.importing import load

__all__ = ["JOBS", "main"]

JOBS = {
    "timeline": ("haptigraph.dashboard.jobs.read:read_run", 15),
    "outcomes": ("haptigraph.dashboard.jobs.read:measure_outcomes", 15),
    "compare": ("haptigraph.dashboard.jobs.compare:compare", 15),
    "csv": ("haptigraph.dashboard.jobs.export:export_csv", 15),
    "png": ("haptigraph.dashboard.jobs.export:export_png", 15),
    "find": ("haptigraph.dashboard.jobs.find:find_recordings", 15),
    "register": ("haptigraph.dashboard.jobs.register:find_eye", 5),  # a run may wait for it
}
"""Function, imported on demand because drawing takes seconds to load, and niceness of each job."""


def main() -> None:
    """Run the job that the command line names."""
    job, folder = sys.argv[1:]
    arguments = pickle.load(sys.stdin.buffer)
    path, nice = JOBS[job]
    _lower_priority(nice)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        os.chdir(folder)
        load(path)(*arguments)
    except HaptigraphError as error:
        _send_problem(str(error))
    except msgspec.MsgspecError as error:
        _send_problem(f"{arguments[0]}: its settings cannot be read ({error})")
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _send_problem(f"{where}{error.strerror or error}")


def _send_problem(sentence: str) -> None:
    send_message({"type": "problem", "problem": sentence})


def _lower_priority(nice: int) -> None:
    cv2.setNumThreads(1)
    if hasattr(os, "nice"):
        with suppress(OSError):
            os.nice(nice)


def _end_with_parent() -> None:
    """Exit when the other end of stdin is closed, for whatever reason."""
    while os.read(sys.stdin.fileno(), 1):
        continue
    os._exit(1)


if __name__ == "__main__":
    main()
