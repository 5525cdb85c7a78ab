"""Run a batch over all recordings below a folder; resumable, and the same result however often it is run."""

from contextlib import closing
from pathlib import Path

from msgspec import Struct

from haptigraph.analysis.archive.recordings import found_recordings
from haptigraph.analysis.batch.results import BatchResults
from haptigraph.analysis.batch.tasks import BatchTask, Done, Kind
from haptigraph.analysis.batch.work import do_task
from haptigraph.analysis.evaluation.origin import software_sha256
from haptigraph.analysis.exporting.runs import SUFFIXES
from haptigraph.assemble import load_procedure
from haptigraph.recording.journal import is_being_written, is_whole, not_being_written
from haptigraph.recording.writer import Progress
from haptigraph.spreading.spread import spread
from haptigraph.spreading.tasks import Cluster, Killed
from haptigraph.version import __version__

__all__ = ["Batch", "Ran", "open_results", "run_batch"]

RESULTS = "results.db"
DOING: dict[Kind, str] = {
    "replay": "replaying",
    "measure": "measuring",
    "evaluate": "evaluating",
    "export": "exporting",
}


class Batch(Struct, frozen=True):
    """What is done, on which recordings."""

    kind: Kind
    folder: Path
    output: Path
    """The folder of results."""
    procedure: str = ""
    """Name or file of another procedure; empty: the recorded one."""
    format: str = "csv"
    """Of the files that an export writes, one of `SUFFIXES`."""

    def about(self) -> dict[str, str]:
        """Return what every result depends on: of a procedure its text, wherever the file is."""
        procedure = load_procedure(self.procedure) if self.procedure else None
        return {
            "kind": self.kind,
            "folder": str(self.folder.resolve()),
            "procedure": f"sha256 {procedure.sha256}" if procedure else "",
            **({"format": self.format} if self.kind == "export" else {}),
            "haptigraph": __version__,
            "software_sha256": software_sha256(),
        }


class Ran(Struct):
    """What a call did."""

    now: int = 0
    """Recordings of this call."""
    before: int = 0
    """Recordings of earlier calls."""
    being_written: int = 0
    """Recordings that were left for a later call."""


def run_batch(
    batch: Batch,
    *,
    workers: int = 1,
    cluster: Cluster | None = None,
    progress: Progress | None = None,
) -> Ran:
    """Do what is missing in the folder of results.

    Args:
        batch: What is done.
        workers: Number of processes on this machine.
        cluster: A Dask cluster to use instead; its workers must see the folder under the same path.
        progress: Called with the number of complete recordings.

    Raises:
        BadInput: If a folder or a procedure cannot be used, the folder has results of another batch, or
            another program is writing them.
        MissingExtra: If the job needs a library that is not installed.
    """
    found = list(found_recordings(batch.folder))
    text = load_procedure(batch.procedure).text if batch.procedure else ""
    batch.output.mkdir(parents=True, exist_ok=True)
    with (
        closing(open_results(batch)) as results,
        not_being_written(
            batch.output / RESULTS, "is being written by another batch; wait for it, or end it"
        ),
    ):
        stored = results.stored()
        results.remove(sorted(stored.keys() - {each.name for each in found}))
        ran, tasks = Ran(), list[BatchTask]()
        where, output = str(batch.folder.resolve()), batch.output.resolve()
        for name, size, changed_ns in found:
            path = batch.folder / name
            if stored.get(name) == (size, changed_ns):
                ran.before += 1
            elif not is_whole(path) and is_being_written(path):
                ran.being_written += 1
            else:
                file = str((output / name).with_suffix(SUFFIXES[batch.format]))
                exported = (file, batch.format) if batch.kind == "export" else ()
                about = (batch.kind, where, name, size, changed_ns, text, batch.procedure)
                tasks.append(BatchTask(*about, *exported))
        total = ran.before + len(tasks)
        if progress is not None:
            progress(DOING[batch.kind], ran.before, total)
        for task, done in spread(do_task, tasks, workers=workers, cluster=cluster) if tasks else ():
            results.add(task, Done(problem=done.problem) if isinstance(done, Killed) else done)
            ran.now += 1
            if progress is not None:
                progress(DOING[batch.kind], ran.before + ran.now, total)
    return ran


def open_results(batch: Batch) -> BatchResults:
    """Open the results of a batch.

    Raises:
        BadInput: If they are those of another one.
    """
    return BatchResults(batch.output / RESULTS, batch.about())
