"""Recordings of a study's trials: where they are, their SHA-256, and whether they are unchanged."""

from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import Any

from sqlalchemy import select

from haptigraph.checksum import sha256_of
from haptigraph.errors import BadInput
from haptigraph.recording.journal import is_being_written, is_whole
from haptigraph.study.store import Row, Store
from haptigraph.study.tables import TRIALS

__all__ = ["fingerprint", "prepare_path", "recorded_trials", "recording_problem", "recordings_folder"]


def recordings_folder(participant: str) -> str:
    """Return the folder that holds a participant's recordings only, relative to the study's folder."""
    return f"recordings/{participant}"


def fingerprint(path: Path, *, must_be_whole: bool = True) -> str | None:
    """Return the SHA-256 of a recording; None if it does not exist, or is incomplete and may be.

    Raises:
        BadInput: If it is incomplete and `must_be_whole` is set.
    """
    if not path.exists() or not (must_be_whole or is_whole(path)):
        return None
    if not is_whole(path):
        raise BadInput(
            "is not closed; end the run, or `haptigraph recover` it, before the trial is ended", path
        )
    return sha256_of(path)


def prepare_path(path: Path) -> None:
    """Create the folder of a recording; rename a recording that was left there without a trial.

    Raises:
        BadInput: If that recording is being written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists():
        return
    if is_being_written(path):
        raise BadInput("is being written; end that run first", path)
    number = next(n for n in count(1) if not path.with_suffix(f".unused{n}.mcap").exists())
    path.rename(path.with_suffix(f".unused{number}.mcap"))


def recorded_trials(store: Store, study: str) -> list[Row]:
    """Return the stored trials that have a complete recording."""
    here = (TRIALS.c.study == study) & TRIALS.c.recording_sha256.is_not(None)
    return store.rows(select(TRIALS).where(here).order_by(TRIALS.c.recording))


def recording_problem(trial: Row | Mapping[str, Any], folder: Path) -> str:
    """Describe the problem with a trial's recording; return "" if it is unchanged."""
    path = folder / trial["recording"]
    if not path.is_file():
        return f"{trial['recording']} is missing"
    is_same = sha256_of(path) == trial["recording_sha256"]
    return "" if is_same else f"{trial['recording']} was changed; its SHA-256 differs"
