"""Erase a participant who withdraws consent: rows and recordings go, pseudonym and place stay.

First the rows, in one transaction; then the recordings; then what is left in the database's own files. Cut
off in between, it is finished by doing it again.
"""

import shutil
from collections.abc import Iterator
from pathlib import Path

from msgspec import Struct
from sqlalchemy import Connection, Table, delete, func, select, update

from haptigraph.errors import BadInput
from haptigraph.recording.journal import is_being_written
from haptigraph.study.progress import of_participant
from haptigraph.study.recordings import place_of
from haptigraph.study.roster import Study
from haptigraph.study.station import open_row, whereabouts
from haptigraph.study.store import Row
from haptigraph.study.tables import METADATA, PARTICIPANTS, SESSIONS, TRIALS, is_erased

__all__ = ["Found", "erase", "find", "forget", "remains"]

OF_PERSONS = [
    table
    for table in reversed(METADATA.sorted_tables)
    if "participant" in table.c and table is not PARTICIPANTS
]
"""In an order in which they can be emptied."""
MADE_OF_ALL = ("participants.csv", "report.html")
"""What an export and a report are known by."""


class Found(Struct, frozen=True):
    """What there is of a participant."""

    slot: int
    """Place in the balancing, from 0."""
    erased_utc: str
    """When the rows were erased, ISO 8601; empty: they are there."""
    rows: dict[str, int]
    """How many, by table."""
    files: list[str]
    """In the study's folder, as paths from there."""
    elsewhere: list[str]
    """Recordings that the store tells of and that are not among `files`, with their station."""
    made_of_all: list[str]
    """Folders in the study's folder with exports and reports, which are of everyone."""


def find(study: Study, participant: str) -> Found:
    """Return what there is of a participant.

    Raises:
        BadInput: If there is none of that pseudonym, or they are at a station, or are being recorded.
    """
    with study.store.begin() as connection:
        person = _absent(connection, study, participant)
        rows = {table.name: _count(connection, table, study, participant) for table in OF_PERSONS}
        told = dict(_recorded(connection, study, participant))
    folder = study.protocol.folder
    files = remains(folder, participant)
    for file in files:
        if (folder / file).is_file() and is_being_written(folder / file):
            raise BadInput("is being written; end that run first", folder / file)
    return Found(
        slot=person["slot"],
        erased_utc=person["withdrawn_utc"] if is_erased(person) else "",
        rows={name: count for name, count in sorted(rows.items()) if count},
        files=files,
        elsewhere=[f"{path} (station {at})" for path, at in sorted(told.items()) if path not in files],
        made_of_all=sorted(
            {
                path.parent.relative_to(folder).as_posix()
                for name in MADE_OF_ALL
                for path in folder.rglob(name)
            }
        ),
    )


def erase(study: Study, participant: str) -> None:
    """Erase a participant for good; the pseudonym is not given again, the place is free.

    Raises:
        BadInput: If there is none of that pseudonym, or they are at a station.
        StoreFailed: If the store does not take it; where the rows are gone, do it again.
    """
    with study.store.begin() as connection:
        person = _absent(connection, study, participant)
        forget(connection, study.name, participant)
        if not is_erased(person):
            now_utc = study.store.now_utc()
            stamps = {"enrolled_utc": now_utc, "consented_utc": None, "withdrawn_utc": now_utc}
            mine = of_participant(PARTICIPANTS, study.name, participant)
            connection.execute(update(PARTICIPANTS).where(*mine).values(stamps))
    place = study.protocol.folder / place_of(participant)
    if place.exists():
        shutil.rmtree(place.resolve())
    if place.is_symlink():
        place.unlink()
    study.store.purge()


def forget(connection: Connection, study: str, participant: str) -> None:
    """Delete all rows of a participant but the one that says who has the place."""
    for table in OF_PERSONS:
        connection.execute(delete(table).where(*of_participant(table, study, participant)))


def remains(folder: Path, participant: str) -> list[str]:
    """Return the files of a participant in a study's folder, as paths from there."""
    place = folder / place_of(participant)
    files = (path for path in place.rglob("*") if path.is_symlink() or not path.is_dir())
    return sorted(path.relative_to(folder).as_posix() for path in files)


def _absent(connection: Connection, study: Study, participant: str) -> Row:
    """Return a participant who is at no station."""
    person = study.participant(connection, participant)
    at = open_row(connection, study, participant)
    if at is not None:
        raise BadInput(f"{whereabouts(at)}; let them leave it (after a crash: resume, then leave)")
    return person


def _count(connection: Connection, table: Table, study: Study, participant: str) -> int:
    mine = of_participant(table, study.name, participant)
    return connection.scalar(select(func.count()).select_from(table).where(*mine)) or 0


def _recorded(connection: Connection, study: Study, participant: str) -> Iterator[tuple[str, str]]:
    """Yield the recordings that the store tells of, with their stations."""
    session = (TRIALS.c.study == SESSIONS.c.study) & (TRIALS.c.participant == SESSIONS.c.participant)
    session &= TRIALS.c.session == SESSIONS.c.session
    mine = (*of_participant(TRIALS, study.name, participant), TRIALS.c.recording.is_not(None))
    for row in connection.execute(select(TRIALS.c.recording, SESSIONS.c.station).where(session, *mine)):
        yield row.recording, row.station
