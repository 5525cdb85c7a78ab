"""Measures of recorded trials that have none yet, into the store. Reads recordings, writes only measures."""

from pathlib import Path

from sqlalchemy import update

from haptigraph.analysis.metrics.trial import measure_recording
from haptigraph.recording.writer import Progress
from haptigraph.study.data_dictionary import check_measures
from haptigraph.study.recordings import recorded_trials, whats_wrong
from haptigraph.study.store import Store, to_json
from haptigraph.study.tables import TRIALS

__all__ = ["measure_study"]


def measure_study(store: Store, study: str, folder: Path, progress: Progress | None = None) -> list[str]:
    """Measure trials that are not measured yet.

    Args:
        store: The store.
        study: The study's name.
        folder: The study's folder, where recordings are.
        progress: Told how far it is.

    Returns:
        A sentence for each recording that is not here or not what was recorded; it is not measured.
    """
    trials = [trial for trial in recorded_trials(store, study) if trial["measures"] is None]
    wrong = []
    for number, trial in enumerate(trials):
        if progress is not None:
            progress("measuring trials", number, len(trials))
        problem = whats_wrong(trial, folder)
        if problem:
            wrong.append(problem)
            continue
        measures = check_measures(measure_recording(folder / trial["recording"]))
        if not measures:
            continue  # the tip was never inside
        key = [column == trial[column.name] for column in TRIALS.primary_key]
        with store.begin() as connection:
            connection.execute(update(TRIALS).where(*key).values(measures=to_json(measures)))
    return wrong
