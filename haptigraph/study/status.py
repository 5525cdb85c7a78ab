"""The status of every participant of a study: progress, next stage, station, and the experimenter's notes."""

from datetime import datetime

from msgspec import Struct
from sqlalchemy import select

from haptigraph.study.progress import Next, next_of, of_participant, read_progress
from haptigraph.study.roster import Study
from haptigraph.study.station import open_session_row
from haptigraph.study.tables import EVENTS

__all__ = ["Event", "ParticipantStatus", "events_of", "participant_statuses"]


class ParticipantStatus(Struct, frozen=True):
    """The status of one participant."""

    participant: str
    order: str
    """Conditions, joined by ">"."""
    next: Next
    station: str
    """Where the participant is; empty: at none."""
    void: int
    """Number of attempts that do not count."""
    left: bool = False
    """Whether the participant has withdrawn."""
    has_consented: bool = False


def participant_statuses(study: Study) -> list[ParticipantStatus]:
    """Return the status of all participants, in the order of enrolment."""
    statuses = []
    now, plan = datetime.fromisoformat(study.store.now_utc()), study.planner()
    for row in study.participants():
        name = row["participant"]
        with study.store.begin() as connection:
            progress = read_progress(connection, study.name, name)
            session = open_session_row(connection, study, name)
        upcoming = next_of(plan(row["slot"]), progress, study.protocol, now)
        station = session.station if session else ""
        void = sum(attempt.void is not None for each in progress.attempts.values() for attempt in each)
        left = row["withdrawn_utc"] is not None
        has_consented = row["consented_utc"] is not None
        statuses.append(
            ParticipantStatus(name, row["conditions"], upcoming, station, void, left, has_consented)
        )
    return statuses


class Event(Struct, frozen=True):
    """An entry of the experimenter, or the participant's answer to a test pulse."""

    kind: str
    """note, stop, felt or unfelt."""
    text: str
    at_utc: str


def events_of(study: Study, participant: str) -> list[Event]:
    """Return the experimenter's entries on a participant, in order."""
    mine = of_participant(EVENTS, study.name, participant)
    rows = study.store.rows(select(EVENTS).where(*mine).order_by(EVENTS.c.number))
    return [Event(row["kind"], row["text"], row["at_utc"]) for row in rows]
