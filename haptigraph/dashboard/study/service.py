"""One station of a study: whom it has, and what its trial is doing.

Pages act here from worker threads, the thread that runs trials takes them from here. What counts is in the
store; what is here ends with the process, and nothing is lost by that.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Literal, TypeAlias

from haptigraph.dashboard.server.site import Site
from haptigraph.errors import BadInput
from haptigraph.study.plan import Stage
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.runner import Session, open_session
from haptigraph.study.station import open_row

__all__ = ["Doing", "Ending", "StationSite", "StudyService"]

Doing: TypeAlias = Literal["", "preparing", "running", "ending"]
"""What a trial is doing here; empty: there is none."""
Ending: TypeAlias = tuple[Literal["ready", "aborted"], str]
"""How somebody ends a trial, and why."""


class StudyService:
    """A station.

    Args:
        path: The study's folder, or its protocol.
        study: The study.
        station: This station's name.
    """

    def __init__(self, path: Path, study: Study, station: str) -> None:
        self.study, self.station = study, station
        self.session: Session | None = None
        """Of the participant who is here."""
        self.doing: Doing = ""
        self.problem = ""
        """Why the last trial could not begin, or be kept; empty: all is well."""
        self.ending: Ending | None = None
        """Set by a page; the trial that runs looks at it with every image."""
        self.begun_ns = 0
        """When the trial that runs had its first image, on the monotonic clock."""
        self.version = 0
        """Grows with every change, so that pages know an old answer when they see one."""
        self.on_change: Callable[[], None] = lambda: None
        self._path = path
        self._lock = threading.RLock()  # held while the store is asked, which may take long
        self._moment = threading.Lock()  # never held for longer than a moment: the loop may wait for it
        self._wishes: SimpleQueue[tuple[Session, Stage]] = SimpleQueue()

    # --- for the experimenter -------------------------------------------------------------------------

    def enrol(self, participant: str | None) -> str:
        """Take a participant into the study; None: by the next free pseudonym.

        Raises:
            BadInput: If the study does not take them, its protocol was changed, or a trial is going on here.
        """
        with self._changing():
            self._must_be_idle()
            self._read_protocol()
            return self.study.enrol(participant)

    def open(self, participant: str, *, take_over: bool) -> None:
        """Bring a participant here; one who is here leaves, and may come back.

        Raises:
            BadInput: If there is none of that name, another station has them, the protocol was changed, or a
                trial is going on here.
        """
        with self._changing():
            self._must_be_idle()
            self._read_protocol()
            before = self.session
            self.session = open_session(self.study, participant, self.station, take_over=take_over)
            self.problem = ""
            if before is not None and self._is_here(before):
                before.close()

    def leave(self, participant: str) -> None:
        """Let the participant who is here go, to come back here or elsewhere.

        Raises:
            BadInput: If another is here, or a trial is going on.
        """
        with self._changing():
            session = self.at_hand(participant)
            self._must_be_idle()
            self.session, self.problem = None, ""
            session.close()

    def withdraw(self, participant: str) -> None:
        """Note that a participant has left the study for good.

        Raises:
            BadInput: If there is none of that name, or their trial is going on.
        """
        with self._changing():
            if self.session is not None and self.session.participant == participant:
                self._must_be_idle()
            self.study.withdraw(participant)

    def abort(self, participant: str, key: str, reason: str) -> None:
        """Give up the trial that runs.

        Raises:
            BadInput: If it does not run, or no reason is given.
        """
        if not reason.strip():
            raise BadInput("a trial is not aborted without a reason; give one")
        self._end(participant, key, ("aborted", reason.strip()))

    def close(self) -> None:
        """Let whoever is here go, at the end of all."""
        with self._lock:
            session = self.here()
            if session is not None:
                session.close()

    # --- for both -------------------------------------------------------------------------------------

    def at_hand(self, participant: str) -> Session:
        """Return the session of a participant who must be here.

        Raises:
            BadInput: If another is here, or nobody.
        """
        session = self.here()
        if session is None or session.participant != participant:
            who = f"{session.participant} is" if session else "nobody is"
            raise BadInput(f"participant {participant!r} is not at this station; {who}")
        return session

    def here(self) -> Session | None:
        """Return the session of the participant who is here, if no other station has taken them over."""
        session = self.session
        return session if session is not None and self._is_here(session) else None

    def begin(self, participant: str, key: str) -> None:
        """Ask for the trial that comes next.

        Raises:
            BadInput: If it does not come next, one is going on, or the protocol was changed.
        """
        with self._changing():
            session = self.at_hand(participant)
            self._must_be_idle()
            self._read_protocol()
            coming = session.next()
            if coming.stage is None or coming.stage.key != key or not coming.stage.is_trial:
                what = coming.stage.key if coming.stage else f"nothing more ({coming.ended})"
                raise BadInput(f"participant {participant}: trial {key} does not come next, but {what}")
            self.ending = None
            self.now("preparing")
            self._wishes.put((session, coming.stage))

    def ready(self, participant: str, key: str) -> None:
        """End the free training that runs.

        Raises:
            BadInput: If it does not run, or is not free.
        """
        session = self.at_hand(participant)
        if not any(stage.key == key and stage.free for stage in session.plan):
            raise BadInput(f"{key} is no free training; it ends by itself")
        self._end(participant, key, ("ready", ""))

    @contextmanager
    def acting(self, participant: str) -> Iterator[Session]:
        """Let a page act on the session of the participant who is here, and tell all pages."""
        with self._changing():
            yield self.at_hand(participant)

    # --- for the thread that runs trials --------------------------------------------------------------

    def wait(self) -> tuple[Session, Stage]:
        """Wait until a trial is asked for."""
        return self._wishes.get()

    def now(self, doing: Doing, problem: str = "", begun_ns: int = 0) -> None:
        """Note what the trial is doing now, and what went wrong."""
        with self._moment:
            self.doing, self.problem, self.begun_ns = doing, problem, begun_ns
        self._tell()

    def _end(self, participant: str, key: str, ending: Ending) -> None:
        coming = self.at_hand(participant).next()
        with self._moment:
            if self.doing != "running" or coming.stage is None or coming.stage.key != key:
                raise BadInput(f"participant {participant}: trial {key} is not running")
            self.ending, self.doing = ending, "ending"
        self._tell()

    def _must_be_idle(self) -> None:
        if self.doing:
            raise BadInput("a trial is going on at this station; let it end, or abort it")

    def _is_here(self, session: Session) -> bool:
        with self.study.store.begin() as connection:
            row = open_row(connection, self.study, session.participant)
        return row is not None and row.session == session.number

    def _read_protocol(self) -> None:
        """Read the protocol anew: until it is frozen an edit counts, afterwards it is refused."""
        study = Study(load_protocol(self._path), self.study.store, self.study.simulated)
        study.check_frozen()
        if study.name != self.study.name:
            raise BadInput(f"the study's name is {study.name!r} now; start haptigraph anew", self._path)
        self.study = study

    @contextmanager
    def _changing(self) -> Iterator[None]:
        with self._lock:
            try:
                yield
            finally:
                self._tell()

    def _tell(self) -> None:
        self.version += 1
        self.on_change()


@dataclass(frozen=True, kw_only=True)
class StationSite(Site):
    """What the routes of a study's pages may use."""

    service: StudyService
