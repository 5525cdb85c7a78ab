"""Where every participant of a study stands: how far, what next, at which station, what was noted."""

from datetime import datetime

from msgspec import Struct
from sqlalchemy import select

from haptigraph.study.plan import plan_of
from haptigraph.study.progress import Next, next_of, of_participant, read_progress
from haptigraph.study.roster import Study
from haptigraph.study.station import open_row
from haptigraph.study.tables import EVENTS

__all__ = ["Event", "Standing", "events_of", "standings"]


class Standing(Struct, frozen=True):
    """Where one participant stands."""

    participant: str
    order: str
    """Conditions, joined by ">"."""
    next: Next
    station: str
    """Which has the participant; empty: none."""
    void: int
    """Attempts at trials that do not count."""
    left: bool = False
    """Whether they have left the study."""


def standings(study: Study) -> list[Standing]:
    """Return where all participants stand, in the order they were taken in."""
    found = []
    now = datetime.fromisoformat(study.store.now_utc())
    for row in study.participants():
        name = row["participant"]
        with study.store.begin() as connection:
            progress = read_progress(connection, study.name, name)
            at = open_row(connection, study, name)
        attempts = [attempt for each in progress.attempts.values() for attempt in each]
        coming = next_of(plan_of(study.protocol, row["slot"]), progress, study.protocol, now)
        void = sum(attempt.void is not None for attempt in attempts)
        left = row["withdrawn_utc"] is not None
        found.append(Standing(name, row["conditions"], coming, at.station if at else "", void, left))
    return found


class Event(Struct, frozen=True):
    """What the experimenter noted."""

    kind: str
    """note, or stop."""
    text: str
    at_utc: str


def events_of(study: Study, participant: str) -> list[Event]:
    """Return what was noted of a participant, in order."""
    mine = of_participant(EVENTS, study.name, participant)
    rows = study.store.rows(select(EVENTS).where(*mine).order_by(EVENTS.c.number))
    return [Event(row["kind"], row["text"], row["at_utc"]) for row in rows]
