"""Advance a participant through a study as a page would, and the time."""

from datetime import UTC, datetime, timedelta

from haptigraph.config import HapticsConfig
from haptigraph.study.plan import Stage
from haptigraph.study.runner import Session

HAPTICS = HapticsConfig()


class TickingClock:
    """A clock that advances by one second on every call."""

    def __init__(self) -> None:
        self.at = datetime(2026, 11, 21, 9, tzinfo=UTC)

    def __call__(self) -> datetime:
        self.at += timedelta(seconds=1)
        return self.at


def fill(session: Session, stage: Stage, upto: int | None = None) -> None:
    """Answer a questionnaire, or its first items."""
    for item in session.study.protocol.questionnaire(stage.questionnaire).items[:upto]:
        given = {"scale": "4", "number": "30", "text": "words"}
        session.answer(stage.key, item.key, given.get(item.kind) or item.choices[0])


def calibrate(session: Session, stage: Stage, threshold: float = 0.1, upto: int | None = None) -> None:
    """Respond to the stimuli of a calibration's task, or to its first; name every pattern correctly."""
    while (stimulus := session.stimulus(HAPTICS)) is not None and session.next().stage == stage:
        if upto is not None and stimulus.number > upto:
            return
        pattern = stimulus.pattern
        felt = "felt" if pattern.amplitude >= threshold else "not felt"
        session.respond(
            stage.key, stimulus.number, felt if stage.task == "threshold" else pattern.name, HAPTICS
        )


def do_next(session: Session, outcome: str = "hit") -> None:
    """Complete the next stage."""
    stage = session.next().stage
    assert stage is not None
    if stage.is_trial:
        if not session.next().running:
            session.begin_trial(stage.key)
        session.end_trial(outcome, measures={"completion_s": 2.5, "contacts": 1, "state_order": "a>b"})
        return
    if stage.kind == "calibration":
        calibrate(session, stage)
        return
    if stage.kind == "questionnaire":
        fill(session, stage)
    session.done(stage.key)


def go_to(session: Session, kind: str, outcome: str = "hit") -> Stage:
    """Complete stages until one of a kind comes next."""
    while (stage := session.next().stage) is not None and stage.kind != kind:
        do_next(session, outcome)
    assert stage is not None
    return stage
