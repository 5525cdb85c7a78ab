"""The station at which a participant is: one at a time; a new session closes an open one.

A session is an uninterrupted period at one station. It ends when the station closes it or, after a crash,
when the next session begins.
"""

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, func, select, update

from haptigraph.config import HapticsConfig
from haptigraph.errors import BadInput
from haptigraph.study.plan import Stage
from haptigraph.study.preparation.asking import Asking
from haptigraph.study.preparation.calibration import Stimulus
from haptigraph.study.progress import Next, Progress, next_of, of_participant, read_progress
from haptigraph.study.roster import Study
from haptigraph.study.tables import PARTICIPANTS, SESSIONS, STAGES, TRIALS

__all__ = [
    "OpenSession",
    "begin_session",
    "end_session",
    "location",
    "open_session_row",
    "without_consent",
]


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


class OpenSession:
    """A participant's open session; every action fails once another session has begun.

    Args:
        study: The study.
        participant: The pseudonym.
        slot: The participant's slot in the counterbalancing.
        number: The session's number.
    """

    def __init__(self, study: Study, participant: str, slot: int, number: int) -> None:
        self.study, self.participant, self.slot, self.number = study, participant, slot, number
        self.plan = study.planner()(slot)
        self._here = {"study": study.name, "participant": participant}

    def next(self) -> Next:
        """Return the next stage."""
        with self.study.store.begin() as connection:
            return self._next(read_progress(connection, self.study.name, self.participant))

    def stimulus(self, haptics: HapticsConfig) -> Stimulus | None:
        """Return the next stimulus of the calibration; None if another stage comes next.

        Args:
            haptics: Device and limits of the station.
        """
        with self.study.store.begin() as connection:
            progress = read_progress(connection, self.study.name, self.participant)
        asking = self._asking(self._next(progress).stage, progress, haptics)
        return asking.stimulus() if asking else None

    def _next(self, progress: Progress) -> Next:
        now = datetime.fromisoformat(self.study.store.now_utc())
        return next_of(self.plan, progress, self.study.protocol, now)

    def _asking(self, stage: Stage | None, progress: Progress, haptics: HapticsConfig) -> Asking | None:
        protocol = self.study.protocol
        if stage is None or stage.task is None or protocol.calibration is None:
            return None
        patterns = protocol.patterns[protocol.condition(protocol.calibration.condition).procedure]
        key = protocol.study.seed, self.slot
        return Asking(stage.task, protocol.calibration, patterns, progress.responses, haptics, key)

    def _complete(self, connection: Connection, key: str) -> str:
        """Store that a stage is complete; return when."""
        now_utc = self.study.store.now_utc()
        row = {**self._here, "stage": key, "session": self.number, "done_utc": now_utc}
        connection.execute(STAGES.insert().values(row))
        return now_utc

    def _expect(self, connection: Connection, key: str) -> tuple[Stage, Next]:
        upcoming = self._next(self._require_open(connection))
        if upcoming.stage is None or upcoming.stage.key != key:
            found = upcoming.stage.key if upcoming.stage else f"nothing more ({upcoming.ended})"
            raise BadInput(f"participant {self.participant}: {key} does not come next, but {found}")
        return upcoming.stage, upcoming

    def _require_open(self, connection: Connection) -> Progress:
        """Return the participant's progress if this is still the open session."""
        session = open_session_row(connection, self.study, self.participant)
        if session is None or session.session != self.number:
            where = f"at {session.station} now" if session else "at no station now"
            raise BadInput(f"participant {self.participant} is {where}; open the session again")
        return read_progress(connection, self.study.name, self.participant)

    def _mine(self, table: Any, row: Mapping[str, object] | None = None) -> list[Any]:
        mine = of_participant(table, self.study.name, self.participant)
        return [*mine, *(table.c[name] == value for name, value in (row or {}).items())]
