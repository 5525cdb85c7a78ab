"""Enrolments before consent: who has not consented yet, and how one is undone.

Enrolling assigns a place in the counterbalancing and a pseudonym. Until the participant consents, both can be
freed as if nobody had been enrolled; afterwards the participant withdraws, and the pseudonym stays in use.
"""

from sqlalchemy import delete, func, select

from haptigraph.errors import BadInput
from haptigraph.study.erasure import PARTICIPANT_TABLES, delete_rows
from haptigraph.study.progress import of_participant
from haptigraph.study.roster import Study
from haptigraph.study.station import open_session_row
from haptigraph.study.tables import PARTICIPANTS, SESSIONS, STAGES, STUDIES

__all__ = ["undo_enrolment", "without_consent"]


def without_consent(study: Study, station: str) -> list[str]:
    """Return who is enrolled, has not consented, and is at this station or at none."""
    waiting = (PARTICIPANTS.c.study == study.name) & PARTICIPANTS.c.consented_utc.is_(None)
    waiting &= PARTICIPANTS.c.withdrawn_utc.is_(None)
    with study.store.begin() as connection:
        query = select(PARTICIPANTS.c.participant).where(waiting).order_by(PARTICIPANTS.c.enrolled_utc)
        sessions = {name: open_session_row(connection, study, name) for name in connection.scalars(query)}
    return [name for name, at in sessions.items() if at is None or at.station == station]


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
