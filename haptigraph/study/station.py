"""Which station has a participant: one at a time, and what was cut off when the one before was left.

A session is a stretch at a station. It ends when the station closes it or, after a crash, when the next one
begins.
"""

from typing import Any

from sqlalchemy import Connection, func, select, update

from haptigraph.errors import BadInput
from haptigraph.study.progress import of_participant
from haptigraph.study.roster import Study
from haptigraph.study.tables import SESSIONS, TRIALS

__all__ = ["arrive", "leave", "open_row", "whereabouts"]


def open_row(connection: Connection, study: Study, participant: str) -> Any:
    """Return the open session of a participant, None if there is none."""
    mine = of_participant(SESSIONS, study.name, participant)
    return connection.execute(select(SESSIONS).where(*mine, SESSIONS.c.closed_utc.is_(None))).first()


def whereabouts(open_: Any) -> str:
    """Say of an open session where that is, and since when."""
    since = open_.opened_utc[:16].replace("T", " ")
    return f"participant {open_.participant} is at station {open_.station} since {since} UTC"


def arrive(connection: Connection, study: Study, participant: str, station: str, *, take_over: bool) -> int:
    """Begin a session, and end the one before if it is still open.

    Returns:
        Its number, from 1.

    Raises:
        BadInput: If another station has the participant and is not to be taken over from.
    """
    before = open_row(connection, study, participant)
    if before is not None and before.station != station and not take_over:
        raise BadInput(f"{whereabouts(before)}; close the session there, or take it over")
    leave(connection, study, participant)
    mine = of_participant(SESSIONS, study.name, participant)
    number = (connection.scalar(select(func.max(SESSIONS.c.session)).where(*mine)) or 0) + 1
    row = {"study": study.name, "participant": participant, "session": number, "station": station}
    connection.execute(SESSIONS.insert().values({**row, "opened_utc": study.store.now_utc()}))
    return number


def leave(connection: Connection, study: Study, participant: str) -> None:
    """End the open session, if there is one; a trial that runs is cut off."""
    now_utc = study.store.now_utc()
    trial = (*of_participant(TRIALS, study.name, participant), TRIALS.c.outcome.is_(None))
    cut_off = {"outcome": "aborted", "void": "interrupted", "ended_utc": now_utc}
    connection.execute(update(TRIALS).where(*trial).values(cut_off))
    session = (*of_participant(SESSIONS, study.name, participant), SESSIONS.c.closed_utc.is_(None))
    connection.execute(update(SESSIONS).where(*session).values(closed_utc=now_utc))
