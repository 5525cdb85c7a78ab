"""Erase the data of a participant who withdraws consent; pseudonym and slot remain. Undo an enrolment.

Deletes the rows in one transaction, then the recordings, then the remnants in the database's own files. After
an interruption, a second call completes it. Until a participant consents, the enrolment can be undone
instead: then pseudonym and slot are free again, as if nobody had been enrolled.
"""

import shutil
from collections.abc import Iterator
from pathlib import Path

from msgspec import Struct
from sqlalchemy import Connection, Table, delete, func, select, update

from haptigraph.errors import BadInput
from haptigraph.recording.journal import is_being_written
from haptigraph.study.progress import of_participant
from haptigraph.study.recordings import recordings_folder
from haptigraph.study.roster import Study
from haptigraph.study.sharing.registry import bundles_of
from haptigraph.study.station import location, open_session_row
from haptigraph.study.store import Row
from haptigraph.study.tables import (
    METADATA,
    PARTICIPANTS,
    SESSIONS,
    STAGES,
    STUDIES,
    TRIALS,
    is_erased,
)

__all__ = ["ParticipantData", "delete_rows", "erase", "find_data", "remaining_files", "undo_enrolment"]

PARTICIPANT_TABLES = [
    table
    for table in reversed(METADATA.sorted_tables)
    if "participant" in table.c and table is not PARTICIPANTS
]
"""In an order that respects foreign keys."""
AGGREGATE_FILES = ("participants.csv", "report.html", "runs.parquet")
"""Files that mark an export, a report or a batch, and an archive of recordings."""


class ParticipantData(Struct, frozen=True):
    """All data of one participant."""

    slot: int
    """Place in the counterbalancing, from 0."""
    erased_utc: str
    """When the rows were erased, ISO 8601; empty: not erased."""
    rows: dict[str, int]
    """Number of rows by table."""
    files: list[str]
    """Paths relative to the study's folder."""
    elsewhere: list[str]
    """Recordings that the store lists and that are not among `files`, with their station."""
    aggregates: list[str]
    """Exports and reports of all participants in the study's folder, without bundles."""
    bundles: list[str]
    """The bundles that contain the participant's data, and under which name."""


def find_data(study: Study, participant: str) -> ParticipantData:
    """Return all data of a participant.

    Raises:
        BadInput: If the pseudonym is unknown, or the participant is at a station or being recorded.
    """
    with study.store.begin() as connection:
        person = _participant_not_at_station(connection, study, participant)
        rows = {table.name: _count(connection, table, study, participant) for table in PARTICIPANT_TABLES}
        recordings = dict(_recordings(connection, study, participant))
    folder = study.protocol.folder
    bundles = list(bundles_of(folder, participant))
    files = remaining_files(folder, participant)
    for file in files:
        if (folder / file).is_file() and is_being_written(folder / file):
            raise BadInput("is being written; end that run first", folder / file)
    return ParticipantData(
        slot=person["slot"],
        erased_utc=person["withdrawn_utc"] if is_erased(person) else "",
        rows={name: count for name, count in sorted(rows.items()) if count},
        files=files,
        elsewhere=[f"{path} (station {at})" for path, at in sorted(recordings.items()) if path not in files],
        aggregates=sorted(
            {
                path.parent.relative_to(folder).as_posix()
                for name in AGGREGATE_FILES
                for path in folder.rglob(name)
                if not any(path.absolute().is_relative_to(bundle.path) for bundle in bundles)
            }
        ),
        bundles=[bundle.described(participant) for bundle in bundles],
    )


def erase(study: Study, participant: str) -> None:
    """Erase a participant's data permanently; the pseudonym stays reserved, the slot becomes free.

    Raises:
        BadInput: If the pseudonym is unknown, or the participant is at a station.
        StoreFailed: If the store reports an error; if the rows are already gone, call it again.
    """
    with study.store.begin() as connection:
        person = _participant_not_at_station(connection, study, participant)
        delete_rows(connection, study.name, participant)
        if not is_erased(person):
            now_utc = study.store.now_utc()
            stamps = {"enrolled_utc": now_utc, "consented_utc": None, "withdrawn_utc": now_utc}
            mine = of_participant(PARTICIPANTS, study.name, participant)
            connection.execute(update(PARTICIPANTS).where(*mine).values(stamps))
    recordings = study.protocol.folder / recordings_folder(participant)
    if recordings.exists():
        shutil.rmtree(recordings.resolve())
    if recordings.is_symlink():
        recordings.unlink()
    study.store.purge()


def delete_rows(connection: Connection, study: str, participant: str) -> None:
    """Delete all rows of a participant except the one that holds pseudonym and slot."""
    for table in PARTICIPANT_TABLES:
        connection.execute(delete(table).where(*of_participant(table, study, participant)))


def remaining_files(folder: Path, participant: str) -> list[str]:
    """Return the files of a participant in a study's folder, as paths relative to it."""
    recordings = folder / recordings_folder(participant)
    files = (path for path in recordings.rglob("*") if path.is_symlink() or not path.is_dir())
    return sorted(path.relative_to(folder).as_posix() for path in files)


def undo_enrolment(study: Study, participant: str) -> None:
    """Delete a participant who has not consented; pseudonym and place are free again.

    The undone enrolment of the only participant unfreezes the protocol.

    Raises:
        BadInput: If the pseudonym is unknown, or the participant has consented, left, or has data.
    """
    with study.store.begin() as connection:
        person = study.participant(connection, participant)
        mine = of_participant(PARTICIPANTS, study.name, participant)
        found = [
            table.name
            for table in PARTICIPANT_TABLES
            if table not in (SESSIONS, STAGES)
            and connection.scalar(select(func.count()).where(*of_participant(table, study.name, participant)))
        ]
        reason = (
            "has consented"
            if person["consented_utc"] is not None
            else "has left the study"
            if person["withdrawn_utc"] is not None
            else f"has {' and '.join(found)} in the store"
            if found
            else ""
        )
        if reason:
            raise BadInput(
                f"participant {participant} {reason}, so the enrolment cannot be undone; withdraw instead"
            )
        delete_rows(connection, study.name, participant)
        connection.execute(delete(PARTICIPANTS).where(*mine))
        here = PARTICIPANTS.c.study == study.name
        if not connection.scalar(select(func.count()).select_from(PARTICIPANTS).where(here)):
            connection.execute(delete(STUDIES).where(STUDIES.c.study == study.name))


def _participant_not_at_station(connection: Connection, study: Study, participant: str) -> Row:
    person = study.participant(connection, participant)
    session = open_session_row(connection, study, participant)
    if session is not None:
        raise BadInput(f"{location(session)}; leave the station first (after a crash: resume, then leave)")
    return person


def _count(connection: Connection, table: Table, study: Study, participant: str) -> int:
    mine = of_participant(table, study.name, participant)
    return connection.scalar(select(func.count()).select_from(table).where(*mine)) or 0


def _recordings(connection: Connection, study: Study, participant: str) -> Iterator[tuple[str, str]]:
    """Yield the recordings that the store lists, with their stations."""
    session = (TRIALS.c.study == SESSIONS.c.study) & (TRIALS.c.participant == SESSIONS.c.participant)
    session &= TRIALS.c.session == SESSIONS.c.session
    mine = (*of_participant(TRIALS, study.name, participant), TRIALS.c.recording.is_not(None))
    for row in connection.execute(select(TRIALS.c.recording, SESSIONS.c.station).where(session, *mine)):
        yield row.recording, row.station
