"""One simulated participant goes through a study: the people's runner, a real store, real recordings.

Turns a study's folder, a seed and a number into rows of the store and one recording a trial. The session
has a time of its own, so the same seed writes the same bytes. Who was cut off begins again, and all is as if
nothing had happened. Knows no measure and no statistics.
"""

from contextlib import closing
from datetime import UTC, datetime, timedelta

from msgspec import Struct
from sqlalchemy import select, update

from haptigraph.config import Config, SourceConfig
from haptigraph.study.erasure import forget
from haptigraph.study.plan import Stage
from haptigraph.study.progress import of_participant
from haptigraph.study.protocol import Protocol, load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.runner import Session, open_session
from haptigraph.study.simulated.actions import act_of, answer_of, recorder_of, rehearse
from haptigraph.study.simulated.participant import Participant, draw_participant
from haptigraph.study.simulated.rehearsal import KNOWN
from haptigraph.study.store import Store
from haptigraph.study.tables import PARTICIPANTS, TRIALS
from haptigraph.version import __version__

__all__ = ["Cast", "SessionTime", "play", "pseudonym"]

STATION = "simulation"
SOURCE = "phantom:simulated_participant"
FIRST = datetime(2000, 1, 1, 9, tzinfo=UTC)  # no time that anybody could have been there
APART = timedelta(hours=4)
WORDS_PER_S = 238 / 60  # silent reading (Brysbaert 2019, J. Mem. Lang. 109; standard)
ANSWER_S = 3.0  # assumed
BREAK_S = 120.0  # assumed
BEGINNING_S = 5.0  # assumed: from a trial's beginning on the page to the hand's


class Cast(Struct, frozen=True):
    """Who plays what: all that a simulated study depends on besides its protocol."""

    folder: str
    store: str
    seed: int
    perceiver: str = KNOWN

    @property
    def says(self) -> str:
        """How it was made, as every participant's notes have it."""
        return (
            f"simulated participant: seed {self.seed}, perceiver {self.perceiver}, haptigraph {__version__}"
        )

    def protocol(self) -> Protocol:
        """Load the protocol.

        Raises:
            BadInput: If it is not sound.
        """
        return load_protocol(self.folder)


class SessionTime:
    """The time of one participant's session; it passes when something takes time.

    Args:
        number: The participant's, from 0.
    """

    def __init__(self, number: int) -> None:
        self.now = FIRST + number * APART

    def __call__(self) -> datetime:
        """Return the time."""
        return self.now

    def passes(self, duration_s: float) -> None:
        """Let time pass."""
        self.now += timedelta(seconds=duration_s)


def pseudonym(number: int) -> str:
    """Return the pseudonym of a simulated participant; people are P01, P02, ..."""
    return f"S{number + 1:02}"


def play(cast: Cast, number: int) -> tuple[int, float]:
    """Lead one participant, who was taken in, through the whole protocol.

    Returns:
        How many trials were steered, and for how long [s, simulated].
    """
    time, who = SessionTime(number), draw_participant(cast.seed, number)
    trials, steered_s = 0, 0.0
    with closing(Store(cast.store, time)) as store:
        study = Study(cast.protocol(), store, simulated=True)
        _forget(study, pseudonym(number))
        session = open_session(study, pseudonym(number), STATION)
        session.note(cast.says)
        while (stage := session.next().stage) is not None:
            if stage.is_trial:
                steered_s += _steer(session, stage, who, cast, time)
                trials += 1
            else:
                _attend(session, stage, cast, time)
        session.close()
    return trials, steered_s


def _forget(study: Study, participant: str) -> None:
    """Let a simulated participant who was cut off begin again, as if there had been no beginning."""
    with study.store.begin() as connection:
        study.frozen(connection)  # raises where it is people's
        mine = of_participant(TRIALS, study.name, participant)
        for recording in filter(None, connection.scalars(select(TRIALS.c.recording).where(*mine)).all()):
            path = study.protocol.folder / recording
            for file in (path, path.with_name(f"{path.name}.part")):
                file.unlink(missing_ok=True)
        forget(connection, study.name, participant)
        again = update(PARTICIPANTS).where(*of_participant(PARTICIPANTS, study.name, participant))
        connection.execute(again.values(consented_utc=None))


def _attend(session: Session, stage: Stage, cast: Cast, time: SessionTime) -> None:
    """Read, rest, or answer a questionnaire."""
    texts = session.study.protocol.texts
    read = {"briefing": texts.briefing, "consent": texts.consent, "thanks": texts.thanks}
    time.passes(len(read.get(stage.kind, "").split()) / WORDS_PER_S)
    if stage.kind == "break":
        time.passes(BREAK_S)
    if stage.kind == "questionnaire":
        for item in session.study.protocol.questionnaire(stage.questionnaire).items:
            time.passes(len(item.text.split()) / WORDS_PER_S + ANSWER_S)
            session.answer(stage.key, item.key, answer_of(item, cast.seed, session.participant, stage))
    session.done(stage.key)


def _steer(session: Session, stage: Stage, who: Participant, cast: Cast, time: SessionTime) -> float:
    """Steer one trial, recorded; return how long it took [s]."""
    config = session.config(Config(source=SourceConfig(uri=SOURCE)))
    act = act_of(session.study.protocol, stage)
    rehearsal = rehearse(act, who, cast.seed, cast.perceiver, config)
    session.begin_trial(stage.key)
    time.passes(BEGINNING_S)
    rehearsal.loop.sinks = (recorder_of(rehearsal, config.recording.path, time.now),)
    last_ns = 0
    try:
        for step in rehearsal.steps():
            last_ns = step.stamp_ns
    finally:
        rehearsal.loop.close()
    time.passes(last_ns / 1e9)
    session.end_trial("hit" if rehearsal.is_hit else "timeout")
    return last_ns / 1e9
