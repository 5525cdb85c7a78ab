"""Whether a trial may begin as far as its haptic output goes: the participant felt a test pulse of it.

A trial with haptic feedback needs an output whose pulse was felt in the same session. Where conditions are
hidden from somebody, so does every trial of a study with haptic feedback; otherwise the test would reveal it.
"""

from sqlalchemy import select

from haptigraph.study.plan import Stage
from haptigraph.study.progress import of_participant
from haptigraph.study.protocol import Protocol
from haptigraph.study.runner import Session
from haptigraph.study.tables import EVENTS

__all__ = ["felt_output", "needs_output"]


def needs_output(protocol: Protocol, stage: Stage) -> bool:
    """Return whether a stage needs an output whose test pulse was felt."""
    if not stage.is_trial:
        return False
    if protocol.study.blind == "nobody":
        return bool(protocol.condition(stage.condition).touch)
    return any(condition.touch for condition in protocol.conditions)


def felt_output(session: Session) -> str:
    """Return the outputs whose pulse was felt in this session; empty: none, or the last was not felt."""
    mine = of_participant(EVENTS, session.study.name, session.participant)
    query = select(EVENTS.c.kind, EVENTS.c.text).where(
        *mine, EVENTS.c.session == session.number, EVENTS.c.kind.in_(("felt", "unfelt"))
    )
    answers = session.study.store.rows(query.order_by(EVENTS.c.number))
    return answers[-1]["text"] if answers and answers[-1]["kind"] == "felt" else ""
