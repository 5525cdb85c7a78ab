"""Recordings of a study's trials: their fingerprints, and whether they are still what was recorded."""

import hashlib
from itertools import count
from pathlib import Path

from sqlalchemy import select

from haptigraph.errors import BadInput
from haptigraph.recording.journal import is_being_written, is_whole
from haptigraph.study.store import Row, Store
from haptigraph.study.tables import TRIALS

__all__ = ["fingerprint", "make_room", "place_of", "recorded_trials", "whats_wrong"]


def place_of(participant: str) -> str:
    """Return the folder of a participant's recordings, and of nothing else, from the study's folder."""
    return f"recordings/{participant}"


def fingerprint(path: Path, *, must_be_whole: bool = True) -> str | None:
    """Return the SHA-256 of a recording; None if it was never made, or is not whole and need not be.

    Raises:
        BadInput: If it must be whole and is not.
    """
    if not path.exists() or not (must_be_whole or is_whole(path)):
        return None
    if not is_whole(path):
        raise BadInput(
            "is not closed; end the run, or `haptigraph recover` it, before the trial is ended", path
        )
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def make_room(path: Path) -> None:
    """Make the folder of a recording, and move aside what was recorded there without a trial's being begun.

    Raises:
        BadInput: If it is being written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists():
        return
    if is_being_written(path):
        raise BadInput("is being written; end that run first", path)
    number = next(n for n in count(1) if not path.with_suffix(f".unused{n}.mcap").exists())
    path.rename(path.with_suffix(f".unused{number}.mcap"))


def recorded_trials(store: Store, study: str) -> list[Row]:
    """Return the trials of which there is a whole recording, as the store has them."""
    here = (TRIALS.c.study == study) & TRIALS.c.recording_sha256.is_not(None)
    return store.rows(select(TRIALS).where(here).order_by(TRIALS.c.recording))


def whats_wrong(trial: Row, folder: Path) -> str:
    """Say what is wrong with the recording of a trial; empty if it is as it was recorded."""
    path = folder / trial["recording"]
    if not path.is_file():
        return f"{trial['recording']} is not here"
    with path.open("rb") as file:
        same = hashlib.file_digest(file, "sha256").hexdigest() == trial["recording_sha256"]
    return "" if same else f"{trial['recording']} is not what was recorded; its SHA-256 differs"
