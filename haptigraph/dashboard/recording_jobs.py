"""What takes long with recordings, in a process of its own: read a run, replay it, measure, export.

`python -m haptigraph.dashboard.recording_jobs JOB FOLDER NAME...` answers on stdout in frames (`frames.py`),
the last of which may be an error. Knows nothing of HTTP. A process, not a thread, so that a loop beside it
keeps its interpreter to itself; it asks for little and ends with its parent.
"""

import os
import sys
import threading
from contextlib import suppress
from importlib import import_module

import cv2
import msgspec

from haptigraph.dashboard.frames import put_frame
from haptigraph.errors import HaptigraphError

__all__ = ["JOBS", "main"]

NICE = 15
JOBS = {
    "timeline": "haptigraph.dashboard.job_reading:read_run",
    "outcomes": "haptigraph.dashboard.job_reading:outcomes",
    "compare": "haptigraph.dashboard.job_comparing:compare",
    "csv": "haptigraph.dashboard.job_exporting:export_csv",
    "png": "haptigraph.dashboard.job_drawing:export_png",
}
"""Imported when asked for: drawing alone takes seconds to load."""


def main() -> None:
    """Do one job and answer on stdout."""
    job, folder, *names = sys.argv[1:]
    _ask_for_little()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        os.chdir(folder)
        module, _, name = JOBS[job].partition(":")
        getattr(import_module(module), name)(*names)
    except HaptigraphError as error:
        put_frame({"type": "error", "message": str(error)})
    except msgspec.MsgspecError as error:
        put_frame({"type": "error", "message": f"{names[0]}: its settings cannot be read ({error})"})
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        put_frame({"type": "error", "message": f"{where}{error.strerror or error}"})


def _ask_for_little() -> None:
    cv2.setNumThreads(1)
    if hasattr(os, "nice"):
        with suppress(OSError):
            os.nice(NICE)


def _end_with_parent() -> None:
    """End when the other side of stdin has gone, however it went."""
    while os.read(sys.stdin.fileno(), 1):
        continue
    os._exit(1)


if __name__ == "__main__":
    main()
