"""The session service of one station: its participant's session, and the status of its trial.

Pages call it from worker threads; the thread that runs trials takes them from here. Everything that counts is
in the store: what is held here ends with the process without loss.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Literal, TypeAlias

from haptigraph.config import HapticsConfig
from haptigraph.dashboard.server.site import Site
from haptigraph.dashboard.study.stimulus import Stimulus
from haptigraph.dashboard.study.touch_output import TouchOutput
from haptigraph.errors import BadInput
from haptigraph.study.erasure import undo_enrolment
from haptigraph.study.plan import Stage
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study, check_pseudonym
from haptigraph.study.runner import Session, open_session
from haptigraph.study.station import open_session_row, without_consent

__all__ = ["StationSite", "StudyService", "TrialEnding", "TrialStatus"]

TrialStatus: TypeAlias = Literal["", "preparing", "running", "ending", "stimulus"]
"""Status of this station's trial; empty: there is none; "stimulus": a vibration outside trials is played."""
TrialEnding: TypeAlias = tuple[Literal["ready", "aborted"], str]
"""How a person ends a trial, and why."""


class StudyService:
    """The service of one station.

    Args:
        path: The study's folder, or its protocol.
        study: The study.
        station: This station's name.
        haptics: Device and limits of this station.
    """

    def __init__(self, path: Path, study: Study, station: str, haptics: HapticsConfig | None = None) -> None:
        self.study, self.station, self.haptics = study, station, haptics or HapticsConfig()
        self.session: Session | None = None
        """Of the participant at this station."""
        self.trial_status: TrialStatus = ""
        self.problem = ""
        """Why the last trial could not begin or be saved; empty: no problem."""
        self.remark = ""
        """What was poor about the data of the last trial; only the experimenter's page shows it."""
        self.ending: TrialEnding | None = None
        """Set by a page; the trial that runs checks it with every image."""
        self.played = ""
        """Name of the last stimulus, once it was played."""
        self.started_ns = 0
        """When the trial that runs had its first image, on the monotonic clock."""
        self.version = 0
        """Increases with every change, so that pages can discard answers that arrive late."""
        self.on_change: Callable[[], None] = lambda: None
        self.touch = TouchOutput(HapticsConfig(), (), lambda *_: None, lambda stamp_ns: None)
        """What participants feel here; without pages nothing."""
        self._path = path
        self._lock = threading.RLock()  # held during store access, which may take long
        self._status_lock = threading.Lock()  # held for a moment only, because the loop may wait for it
        self._requested: SimpleQueue[tuple[Session, Stage] | Stimulus] = SimpleQueue()

    # --- for the experimenter -------------------------------------------------------------------------

    def enrol(self, participant: str | None, *, is_confirmed: bool = False) -> str:
        """Enrol a participant; None: under the next free pseudonym.

        Args:
            participant: The pseudonym.
            is_confirmed: Whether to enrol although somebody enrolled here has not consented yet.

        Raises:
            BadInput: If the study refuses them, its protocol was changed, a trial is running here, or
                somebody has not consented yet.
        """
        with self._changing():
            self._check_idle()
            self._reload_protocol()
            if participant is not None:
                check_pseudonym(participant)
            waiting = [] if is_confirmed else without_consent(self.study, self.station)
            if waiting:
                have = "has" if len(waiting) == 1 else "have"
                problem = f"{', '.join(waiting)} {have} a place in the study, but {have} not consented yet"
                raise BadInput(f"{problem}; undo the enrolment, or confirm that you enrol another one")
            return self.study.enrol(participant)

    def undo_enrolment(self, participant: str) -> None:
        """Undo the enrolment of the participant at this station, who has not consented.

        Raises:
            BadInput: If they are not here, have consented, or have data.
        """
        with self._changing():
            self.session_of(participant)
            undo_enrolment(self.study, participant)
            self.session, self.problem = None, ""

    def open(self, participant: str, *, take_over: bool) -> None:
        """Open a participant's session at this station; the present one is closed and may be opened again.

        Raises:
            BadInput: If there is none of that name, another station has them, the protocol was changed, or a
                trial is running here.
        """
        with self._changing():
            self._check_idle()
            self._reload_protocol()
            previous = self.session
            self.session = open_session(self.study, participant, self.station, take_over=take_over)
            self.problem = self.remark = ""
            if previous is not None and self._is_here(previous):
                previous.close()

    def leave(self, participant: str) -> None:
        """Close a participant's session at this station; it may be opened again, here or elsewhere.

        Raises:
            BadInput: If they are not at this station, or a trial is running.
        """
        with self._changing():
            session = self.session_of(participant)
            self._check_idle()
            self.session, self.problem, self.remark = None, "", ""
            session.close()

    def withdraw(self, participant: str) -> None:
        """Record that a participant has left the study for good.

        Raises:
            BadInput: If there is none of that name, or their trial is running.
        """
        with self._changing():
            if self.session is not None and self.session.participant == participant:
                self._check_idle()
            self.study.withdraw(participant)

    def abort(self, participant: str, key: str, reason: str) -> None:
        """Abort the trial that runs.

        Raises:
            BadInput: If it does not run, or no reason is given.
        """
        if not reason.strip():
            raise BadInput("a trial cannot be aborted without a reason; give one")
        self._end(participant, key, ("aborted", reason.strip()))

    def close(self) -> None:
        """Close the present session when the program ends."""
        with self._lock:
            session = self.current_session()
            if session is not None:
                session.close()

    # --- for both pages -------------------------------------------------------------------------------

    def session_of(self, participant: str) -> Session:
        """Return the session of a participant who must be at this station.

        Raises:
            BadInput: If another participant is here, or none.
        """
        session = self.current_session()
        if session is None or session.participant != participant:
            who = f"{session.participant} is" if session else "nobody is"
            raise BadInput(f"participant {participant!r} is not at this station; {who}")
        return session

    def current_session(self) -> Session | None:
        """Return the session at this station, unless another station has taken it over."""
        session = self.session
        return session if session is not None and self._is_here(session) else None

    def begin(self, participant: str, key: str) -> None:
        """Request the next trial.

        Raises:
            BadInput: If another stage comes next, a trial is running, the protocol was changed, or the
                participant has felt no test pulse where the trial needs one.
        """
        with self._changing():
            self._reload_protocol()
            session, stage = self._trial_to_begin(participant, key)
            if problem := self.touch.problem(session, stage):
                raise BadInput(problem)
            self.ending = None
            self.set_trial_status("preparing")
            self._requested.put((session, stage))

    def play_pulse(self, participant: str, key: str) -> None:
        """Play the test pulse before a trial.

        Raises:
            BadInput: If the trial does not come next, or there is no haptic output.
            DeviceError: If the device failed.
        """
        with self._changing():
            session, _ = self._trial_to_begin(participant, key)
            self.touch.play(session)

    def answer_pulse(self, participant: str, key: str, *, is_felt: bool) -> None:
        """Store whether the participant felt the test pulse.

        Raises:
            BadInput: If the trial does not come next, or no pulse was played on the present outputs.
        """
        with self._changing():
            session, _ = self._trial_to_begin(participant, key)
            self.touch.answer(session, is_felt=is_felt)

    def ready(self, participant: str, key: str) -> None:
        """End the free training that runs.

        Raises:
            BadInput: If it does not run, or is not free training.
        """
        session = self.session_of(participant)
        if not any(stage.key == key and stage.free for stage in session.plan):
            raise BadInput(f"{key} is not free training; it ends by itself")
        self._end(participant, key, ("ready", ""))

    def request_stimulus(self, participant: str, stimulus: Stimulus) -> None:
        """Request a vibration outside trials, which a person at a page has asked for.

        Raises:
            BadInput: If the participant is not here, something is being played, or there is no output.
        """
        with self._changing():
            self.session_of(participant)
            self._check_idle()
            self.touch.checked_name()
            self.played = ""
            self.set_trial_status("stimulus")
            self._requested.put(stimulus)

    @contextmanager
    def acting_on(self, participant: str) -> Iterator[Session]:
        """Let a page change the session of a participant who must be here; notifies all pages."""
        with self._changing():
            yield self.session_of(participant)

    # --- for the thread that runs trials --------------------------------------------------------------

    def next_trial(self) -> tuple[Session, Stage] | Stimulus:
        """Wait until a trial or a stimulus is requested."""
        return self._requested.get()

    def set_trial_status(
        self, status: TrialStatus, problem: str = "", started_ns: int = 0, remark: str = ""
    ) -> None:
        """Set the status of the trial, what went wrong, and what was poor about its data."""
        with self._status_lock:
            self.trial_status, self.problem, self.started_ns = status, problem, started_ns
            self.remark = remark
        self.notify()

    def _trial_to_begin(self, participant: str, key: str) -> tuple[Session, Stage]:
        session = self.session_of(participant)
        self._check_idle()
        coming = session.next()
        if coming.stage is None or coming.stage.key != key or not coming.stage.is_trial:
            what = coming.stage.key if coming.stage else f"nothing more ({coming.ended})"
            raise BadInput(f"participant {participant}: trial {key} does not come next, but {what}")
        return session, coming.stage

    def _end(self, participant: str, key: str, ending: TrialEnding) -> None:
        coming = self.session_of(participant).next()
        with self._status_lock:
            if self.trial_status != "running" or coming.stage is None or coming.stage.key != key:
                raise BadInput(f"participant {participant}: trial {key} is not running")
            self.ending, self.trial_status = ending, "ending"
        self.notify()

    def _check_idle(self) -> None:
        if self.trial_status:
            what = "a vibration is played" if self.trial_status == "stimulus" else "a trial is running"
            raise BadInput(f"{what} at this station; wait until it ends, or abort it")

    def _is_here(self, session: Session) -> bool:
        with self.study.store.begin() as connection:
            row = open_session_row(connection, self.study, session.participant)
        return row is not None and row.session == session.number

    def _reload_protocol(self) -> None:
        """Read the protocol again; edits apply until it is frozen and are refused afterwards."""
        study = Study(load_protocol(self._path), self.study.store, self.study.simulated)
        study.check_frozen()
        if study.name != self.study.name:
            raise BadInput(f"the study's name has changed to {study.name!r}; restart haptigraph", self._path)
        self.study = study

    @contextmanager
    def _changing(self) -> Iterator[None]:
        with self._lock:
            try:
                yield
            finally:
                self.notify()

    def notify(self) -> None:
        """Let all pages refresh."""
        self.version += 1
        self.on_change()


@dataclass(frozen=True, kw_only=True)
class StationSite(Site):
    """Context of the routes of a study's pages."""

    service: StudyService
