"""One simulated participant's study: the session runner for people, an actual store, actual recordings.

Writes rows of the store and one recording per trial. The session has a clock of its own, so the same seed
writes the same bytes. An interrupted participant starts over, without a trace of the interruption.
"""

import warnings
from contextlib import closing
from datetime import UTC, datetime, timedelta

from msgspec import Struct
from sqlalchemy import select, update

from haptigraph.config import Config, SourceConfig
from haptigraph.errors import RenamedKey
from haptigraph.study.erasure import delete_rows
from haptigraph.study.plan import Stage
from haptigraph.study.progress import of_participant
from haptigraph.study.protocol import Protocol, load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.runner import Session, open_session
from haptigraph.study.simulated.actions import answer_to, recorder_of, rehearse, trial_spec
from haptigraph.study.simulated.calibration import response_to
from haptigraph.study.simulated.ground_truth import GROUND_TRUTH, OLD_NAMES
from haptigraph.study.simulated.participant import Participant, draw_participant
from haptigraph.study.store import Store
from haptigraph.study.tables import PARTICIPANTS, TRIALS
from haptigraph.version import __version__

__all__ = ["SessionClock", "SimulationSpec", "pseudonym", "simulate_participant"]

STATION = "simulation"
SOURCE = "phantom:simulated_participant"
EQUIVALENT_VERSIONS = ("0.1.0",)
"""Earlier versions whose simulated participants behave identically."""
FIRST = datetime(2000, 1, 1, 9, tzinfo=UTC)  # before the software existed, so clearly not of people
SPACING = timedelta(hours=4)
WORDS_PER_S = 238 / 60  # silent reading (Brysbaert 2019, J. Mem. Lang. 109; standard)
ANSWER_S = 3.0  # assumed
BREAK_S = 120.0  # assumed
STIMULUS_S = 3.0  # assumed: from one response to the next
START_S = 5.0  # assumed: from the start of a trial on the page to that of the movement


class SimulationSpec(Struct, frozen=True):
    """All that a simulated study depends on besides its protocol."""

    folder: str
    store: str
    seed: int
    perceiver: str = GROUND_TRUTH

    @property
    def notes(self) -> list[str]:
        """Notes that document these settings: the one that is written, then equivalent earlier ones."""
        names = [self.perceiver, *(old for old, new in OLD_NAMES.items() if new == self.perceiver)]
        return [
            f"simulated participant: seed {self.seed}, perceiver {name}, haptigraph {version}"
            for version in (__version__, *EQUIVALENT_VERSIONS)
            for name in names
        ]

    def protocol(self) -> Protocol:
        """Load the protocol.

        Raises:
            BadInput: If it is invalid.
        """
        return load_protocol(self.folder)


class SessionClock:
    """The clock of one participant's session.

    Args:
        number: The participant's number, from 0.
    """

    def __init__(self, number: int) -> None:
        self.now = FIRST + number * SPACING

    def __call__(self) -> datetime:
        """Return the time."""
        return self.now

    def advance(self, duration_s: float) -> None:
        """Advance the clock."""
        self.now += timedelta(seconds=duration_s)


def pseudonym(number: int) -> str:
    """Return the pseudonym of a simulated participant; people are P01, P02, ..."""
    return f"S{number + 1:02}"


def simulate_participant(spec: SimulationSpec, number: int) -> tuple[int, float]:
    """Simulate the whole study of one enrolled participant.

    Returns:
        The number of trials, and their duration [s, simulated].
    """
    clock, participant = SessionClock(number), draw_participant(spec.seed, number)
    trials, steered_s = 0, 0.0
    with (
        warnings.catch_warnings(action="ignore", category=RenamedKey),  # `simulate` has shown them
        closing(Store(spec.store, clock)) as store,
    ):
        study = Study(spec.protocol(), store, simulated=True)
        _restart(study, pseudonym(number))
        session = open_session(study, pseudonym(number), STATION)
        session.note(spec.notes[0])
        while (stage := session.next().stage) is not None:
            if stage.is_trial:
                steered_s += _perform_trial(session, stage, participant, spec, clock)
                trials += 1
            elif stage.task is not None:
                _calibrate(session, stage, participant, spec, clock)
            else:
                _complete(session, stage, spec, clock)
        session.close()
    return trials, steered_s


def _restart(study: Study, participant: str) -> None:
    """Delete the data of a simulated participant who was interrupted."""
    with study.store.begin() as connection:
        study.frozen(connection)  # raises BadInput for a study of people
        mine = of_participant(TRIALS, study.name, participant)
        for recording in filter(None, connection.scalars(select(TRIALS.c.recording).where(*mine)).all()):
            path = study.protocol.folder / recording
            for file in (path, path.with_name(f"{path.name}.part")):
                file.unlink(missing_ok=True)
        delete_rows(connection, study.name, participant)
        row = update(PARTICIPANTS).where(*of_participant(PARTICIPANTS, study.name, participant))
        connection.execute(row.values(consented_utc=None))


def _complete(session: Session, stage: Stage, spec: SimulationSpec, clock: SessionClock) -> None:
    """Read, rest, or answer a questionnaire."""
    texts = session.study.protocol.texts
    read = {"briefing": texts.briefing, "consent": texts.consent, "thanks": texts.thanks}
    clock.advance(len(read.get(stage.kind, "").split()) / WORDS_PER_S)
    if stage.kind == "break":
        clock.advance(BREAK_S)
    if stage.kind == "questionnaire":
        for item in session.study.protocol.questionnaire(stage.questionnaire).items:
            clock.advance(len(item.text.split()) / WORDS_PER_S + ANSWER_S)
            session.answer(stage.key, item.key, answer_to(item, spec.seed, session.participant, stage))
    session.done(stage.key)


def _calibrate(
    session: Session, stage: Stage, participant: Participant, spec: SimulationSpec, clock: SessionClock
) -> None:
    """Respond to every stimulus of a task of the calibration."""
    haptics = Config().haptics
    while session.next().stage == stage and (stimulus := session.stimulus(haptics)) is not None:
        clock.advance(STIMULUS_S)
        key = spec.seed, stage.key, participant.number
        response = response_to(stimulus, participant, *key)
        session.respond(stage.key, stimulus.number, response, haptics)


def _perform_trial(
    session: Session, stage: Stage, participant: Participant, spec: SimulationSpec, clock: SessionClock
) -> float:
    """Perform and record one trial; return its duration [s]."""
    config = session.config(Config(source=SourceConfig(uri=SOURCE)))
    trial = trial_spec(session.study.protocol, stage)
    rehearsal = rehearse(trial, participant, spec.seed, spec.perceiver, config)
    session.begin_trial(stage.key)
    clock.advance(START_S)
    rehearsal.loop.sinks = (recorder_of(rehearsal, config.recording.path, clock.now),)
    try:
        for _ in rehearsal.steps():
            pass
    finally:
        rehearsal.loop.close()
    clock.advance(rehearsal.steered_s)
    session.end_trial("hit" if rehearsal.is_hit else "timeout")
    return rehearsal.steered_s
