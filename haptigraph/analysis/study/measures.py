"""Compute the measures of recorded trials, the missing or all, and store them."""

import warnings
from pathlib import Path

from sqlalchemy import update

from haptigraph.analysis.metrics.trial import measure_recording
from haptigraph.errors import RenamedKey
from haptigraph.recording.writer import Progress
from haptigraph.study.data_dictionary import check_measures
from haptigraph.study.recordings import recorded_trials, recording_problem
from haptigraph.study.store import Store, to_json
from haptigraph.study.tables import TRIALS

__all__ = ["measure_study"]


def measure_study(
    store: Store, study: str, folder: Path, progress: Progress | None = None, *, again: bool = False
) -> list[str]:
    """Measure the recorded trials that have no measures.

    Args:
        store: The store.
        study: The study's name.
        folder: The study's folder, with its recordings.
        progress: Called with the progress.
        again: Whether to measure all recorded trials, and replace their measures.

    Returns:
        A sentence for each recording that could not be measured, because it is missing or was changed.
    """
    trials = [trial for trial in recorded_trials(store, study) if again or trial["measures"] is None]
    problems = []
    for number, trial in enumerate(trials):
        if progress is not None:
            progress("measuring trials", number, len(trials))
        problem = recording_problem(trial, folder)
        if problem:
            problems.append(problem)
            continue
        with warnings.catch_warnings(action="ignore", category=RenamedKey):  # in the recorded procedure
            measures = check_measures(measure_recording(folder / trial["recording"]))
        if not measures:
            continue  # it has no two steps
        key = [column == trial[column.name] for column in TRIALS.primary_key]
        with store.begin() as connection:
            connection.execute(update(TRIALS).where(*key).values(measures=to_json(measures)))
    return problems
