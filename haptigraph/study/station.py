"""The station at which a participant is: one at a time; a new session closes an open one.

A session is an uninterrupted period at one station. It ends when the station closes it or, after a crash,
when the next session begins.
"""

from typing import Any

from sqlalchemy import Connection, func, select, update

from haptigraph.errors import BadInput
from haptigraph.study.progress import of_participant
from haptigraph.study.roster import Study
from haptigraph.study.tables import PARTICIPANTS, SESSIONS, TRIALS

__all__ = ["begin_session", "end_session", "location", "open_session_row", "without_consent"]


def open_session_row(connection: Connection, study: Study, participant: str) -> Any:
    """Return the row of a participant's open session, or None."""
    mine = of_participant(SESSIONS, study.name, participant)
    return connection.execute(select(SESSIONS).where(*mine, SESSIONS.c.closed_utc.is_(None))).first()


def location(session: Any) -> str:
    """Describe where the participant of an open session is, and since when."""
    since = session.opened_utc[:16].replace("T", " ")
    return f"participant {session.participant} is at station {session.station} since {since} UTC"


def without_consent(study: Study, station: str) -> list[str]:
    """Return who is enrolled, has not consented, and is at this station or at none."""
    waiting = (PARTICIPANTS.c.study == study.name) & PARTICIPANTS.c.consented_utc.is_(None)
    waiting &= PARTICIPANTS.c.withdrawn_utc.is_(None)
    with study.store.begin() as connection:
        query = select(PARTICIPANTS.c.participant).where(waiting).order_by(PARTICIPANTS.c.enrolled_utc)
        sessions = {name: open_session_row(connection, study, name) for name in connection.scalars(query)}
    return [name for name, at in sessions.items() if at is None or at.station == station]


def begin_session(
    connection: Connection, study: Study, participant: str, station: str, *, take_over: bool
) -> int:
    """Begin a session; end the previous one if it is still open.

    Returns:
        The session's number, from 1.

    Raises:
        BadInput: If the participant is at another station and `take_over` is false.
    """
    before = open_session_row(connection, study, participant)
    if before is not None and before.station != station and not take_over:
        raise BadInput(f"{location(before)}; close the session there, or take it over")
    end_session(connection, study, participant)
    mine = of_participant(SESSIONS, study.name, participant)
    number = (connection.scalar(select(func.max(SESSIONS.c.session)).where(*mine)) or 0) + 1
    row = {"study": study.name, "participant": participant, "session": number, "station": station}
    connection.execute(SESSIONS.insert().values({**row, "opened_utc": study.store.now_utc()}))
    return number


def end_session(connection: Connection, study: Study, participant: str) -> None:
    """End the open session, if there is one; a running trial is marked as interrupted."""
    now_utc = study.store.now_utc()
    trial = (*of_participant(TRIALS, study.name, participant), TRIALS.c.outcome.is_(None))
    interrupted = {"outcome": "aborted", "void": "interrupted", "ended_utc": now_utc}
    connection.execute(update(TRIALS).where(*trial).values(interrupted))
    session = (*of_participant(SESSIONS, study.name, participant), SESSIONS.c.closed_utc.is_(None))
    connection.execute(update(SESSIONS).where(*session).values(closed_utc=now_utc))
