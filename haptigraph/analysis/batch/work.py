"""Do a batch's task in a worker: never raises for what is wrong with one recording."""

import os
import time
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2

from haptigraph.analysis.batch.replaying import Moments, figures
from haptigraph.analysis.batch.scoring import score_recording
from haptigraph.analysis.batch.tasks import BatchTask, Done, Kind
from haptigraph.analysis.exporting.runs import export_run
from haptigraph.analysis.metrics.replay import recorded_procedure, replay
from haptigraph.assemble import parse_procedure
from haptigraph.errors import BadInput, MissingExtra
from haptigraph.inference.procedure import Procedure
from haptigraph.recording.reader import RunReader

__all__ = ["do_task"]


def do_task(task: BatchTask) -> Done:
    """Do a task; a recording that it cannot be done on is a result with a problem.

    Raises:
        BadInput: If this worker does not see the recording.
        MissingExtra: If a library is not installed; that says nothing about the recording.
    """
    cv2.setNumThreads(1)  # the workers share the processor already
    path, start_s = Path(task.folder) / task.name, time.process_time()
    if not path.is_file():
        raise BadInput("is not visible to a worker; recordings belong on a disk that all workers share", path)
    try:
        result, problem = WORK[task.kind](path, task), ""
    except MissingExtra:
        raise
    except Exception as error:  # one recording must not end the batch
        result, problem = {}, _sentence(error, path)
    return Done(result, problem, time.process_time() - start_s)


def _sentence(error: Exception, path: Path) -> str:
    if isinstance(error, BadInput):
        where = f"{error.place}: " if error.place and str(error.file) == str(path) else ""
        return f"{where}{error.problem}"
    return str(error) if isinstance(error, OSError) else f"{type(error).__name__}: {error}"


@lru_cache(maxsize=4)
def _parsed(text: str, name: str) -> Procedure:
    return parse_procedure(text, name)


def _procedure(task: BatchTask) -> Procedure | None:
    return _parsed(task.procedure, task.procedure_name) if task.procedure else None


def _replay(path: Path, task: BatchTask) -> dict[str, Any]:
    other = _procedure(task)
    recorded = recorded_procedure(RunReader(path))
    moments = Moments(recorded.kinds, (other or recorded).kinds)
    report = replay(path, other, watch=moments.add)
    return {
        "steps": report.steps,
        "identical": report.identical,
        "states_differ": report.states_differ,
        "haptics_differ": report.haptics_differ,
        "states_differ_s": report.states.lasts_s,
        "haptics_differ_s": report.haptics.lasts_s,
        "first_state_s": report.states.first_s if report.states_differ else None,
        "first_haptics_s": report.haptics.first_s if report.haptics_differ else None,
        "first_step": min(
            (each.first_step for each in (report.states, report.haptics) if each.first_step is not None),
            default=None,
        ),
        "dropped_images": report.dropped_images,
        "differing_images": report.differing_images,
        "is_interrupted": not report.is_whole,
        **moments.found(),
        "recorded": figures(report.recorded, report.recorded_patterns),
        "replayed": figures(report.replayed, report.replayed_patterns),
    }


def _measure(path: Path, task: BatchTask) -> dict[str, Any]:
    try:
        from haptigraph.analysis.metrics.trial import measure_recording  # noqa: PLC0415 - needs an extra
    except ModuleNotFoundError:
        raise MissingExtra("measuring a recording", "study") from None
    return dict(measure_recording(path))


def _evaluate(path: Path, task: BatchTask) -> dict[str, Any]:
    return score_recording(RunReader(path), _procedure(task))


def _export(path: Path, task: BatchTask) -> dict[str, Any]:
    """Write the file under another name first: one that exists is complete."""
    output = Path(task.output)
    output.parent.mkdir(parents=True, exist_ok=True)
    temporary = output.with_name(f".{os.getpid()}.{output.name}")  # the ending chooses a video's container
    try:
        export_run(path, task.format, temporary, name=Path(task.name).with_suffix("").as_posix())
        temporary.replace(output)
    finally:
        temporary.unlink(missing_ok=True)
    return {"file": output.name, "bytes": output.stat().st_size}


WORK: dict[Kind, Callable[[Path, BatchTask], dict[str, Any]]] = {
    "replay": _replay,
    "measure": _measure,
    "evaluate": _evaluate,
    "export": _export,
}
