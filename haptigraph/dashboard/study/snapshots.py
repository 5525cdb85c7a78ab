"""Snapshots of a study for its pages, as JSON content: everything but what blinding hides from a reader."""

import time
from typing import Any, Literal, TypeAlias

from msgspec import to_builtins

from haptigraph.dashboard.study.calibration import calibration_content, calibration_text
from haptigraph.dashboard.study.service import StudyService
from haptigraph.study.plan import Stage, condition_title
from haptigraph.study.progress import Next, Progress, read_progress, repeatable
from haptigraph.study.protocol import Protocol
from haptigraph.study.runner import Session
from haptigraph.study.status import ParticipantStatus, events_of, participant_statuses

__all__ = ["experimenter_snapshot", "participant_snapshot"]

Reader: TypeAlias = Literal["participant", "experimenter"]
TITLES = {"briefing": "Briefing", "consent": "Consent", "break": "Break", "thanks": "Thanks"}
TITLES |= {"threshold": "Did you feel it?", "patterns": "Which one was it?"}


def participant_snapshot(service: StudyService) -> dict[str, Any]:
    """Return what the participant's page shows: who, the next stage, and the status of its trial."""
    session = service.current_session()
    content: dict[str, Any] = {**_common(service), "participant": session.participant if session else ""}
    if session is None:
        return content
    coming, protocol = session.next(), service.study.protocol
    content |= {
        "done": coming.done,
        "total": coming.of,
        "ended": coming.ended,
        "thanks": protocol.texts.thanks,
    }
    if coming.stage is not None:
        stage = _stage(protocol, coming.stage, coming, "participant")
        own = (
            _stage_content(protocol, coming.stage, coming)
            if coming.stage.task is None
            else calibration_content(service, session, coming.stage.key)
        )
        content["stage"] = stage | own
        content["touch"] = _touch(service, session, coming.stage)
    return content


def experimenter_snapshot(service: StudyService) -> dict[str, Any]:
    """Return what the experimenter's page shows: the session here, and the progress of all participants."""
    session, study = service.current_session(), service.study
    shows_conditions = study.protocol.study.blind != "everyone"
    return {
        **_common(service),
        "name": study.name,
        "station": service.station,
        "max_participants": study.protocol.study.participants,
        "shows_conditions": shows_conditions,
        "problem": service.problem,
        "remark": service.remark,
        "elapsed_s": (time.monotonic_ns() - service.started_ns) / 1e9 if service.started_ns else None,
        "current": _current(service, session) if session else None,
        "participants": [
            _standing(study.protocol, each, shows_conditions) for each in participant_statuses(study)
        ],
    }


def _common(service: StudyService) -> dict[str, Any]:
    return {
        "version": service.version,
        "title": service.study.protocol.study.title,
        "simulated": service.study.simulated,
        "trial_status": service.trial_status,
        "has_problem": bool(service.problem),
    }


def _current(service: StudyService, session: Session) -> dict[str, Any]:
    study = service.study
    with study.store.begin() as connection:
        progress = read_progress(connection, study.name, session.participant)
    coming = session.next()
    again = repeatable(session.plan, progress, coming)
    trial = coming.stage if coming.stage and coming.stage.is_trial else None
    stage = _stage(study.protocol, coming.stage, coming, "experimenter") if coming.stage else None
    if stage and coming.stage and coming.stage.task is not None:
        stage |= calibration_content(service, session, coming.stage.key)
    shows_condition = trial is not None and study.protocol.study.blind != "everyone"
    return {
        "has_haptics": not (trial and shows_condition)
        or bool(study.protocol.condition(trial.condition).touch),
        "participant": session.participant,
        "touch": _touch(service, session, coming.stage),
        "may_undo_enrolment": progress.consented_utc is None and not progress.withdrawn,
        "done": coming.done,
        "total": coming.of,
        "ended": coming.ended,
        "stage": stage,
        "calibration": calibration_text(service, progress),
        "repeatable": again.key if again else "",
        "plan": [
            _plan_row(study.protocol, stage, progress, number < coming.done)
            for number, stage in enumerate(session.plan)
        ],
        "events": to_builtins(events_of(study, session.participant)),
    }


def _touch(service: StudyService, session: Session, stage: Stage | None) -> dict[str, str]:
    """Return the haptic outputs, and why a trial must not begin with them; the same for all conditions."""
    problem = service.touch.problem(session, stage) if stage else ""
    return {"output": service.touch.name, "problem": problem}


def _stage(protocol: Protocol, stage: Stage, coming: Next, reader: Reader) -> dict[str, Any]:
    """Describe a stage as far as a reader may know it."""
    return {
        "key": stage.key,
        "kind": stage.kind,
        "title": _title(protocol, stage),
        "condition": condition_title(protocol, stage, reader),
        "attempt": coming.attempt,
        "running": coming.running,
        "timeout_s": stage.timeout_s,
        "free": stage.free,
        "answer_count": len(coming.answers),
        "item_count": len(protocol.questionnaire(stage.questionnaire).items) if stage.questionnaire else 0,
    }


def _stage_content(protocol: Protocol, stage: Stage, coming: Next) -> dict[str, Any]:
    """Return the texts, items and answers of a stage, which only the participant's page shows."""
    texts = protocol.texts
    by_kind = {"briefing": texts.briefing, "consent": texts.consent, "break": texts.break_text}
    by_kind["thanks"] = texts.thanks
    if stage.kind in by_kind:
        return {"text": by_kind[stage.kind]}
    if stage.is_trial:
        return {"display": protocol.condition(stage.condition).display}
    questionnaire = protocol.questionnaire(stage.questionnaire)
    items = [{**to_builtins(item), "valid": item.valid} for item in questionnaire.items]
    intro, source = questionnaire.intro, questionnaire.source
    return {"intro": intro, "source": source, "items": items, "answers": dict(coming.answers)}


def _title(protocol: Protocol, stage: Stage) -> str:
    if stage.kind == "questionnaire":
        return protocol.questionnaire(stage.questionnaire).title
    if not stage.is_trial:
        return TITLES[stage.task or stage.kind]
    if stage.kind == "training":
        number, count = stage.trial, protocol.training.trials if protocol.training else 1
    else:
        each = protocol.trials.repetitions
        number, count = (stage.block - 1) * each + stage.trial, each * protocol.trials.blocks
    what = stage.kind.capitalize()
    return what if count == 1 else f"{what} {number} of {count}"


def _plan_row(protocol: Protocol, stage: Stage, progress: Progress, is_done: bool) -> dict[str, Any]:
    return {
        "key": stage.key,
        "title": _title(protocol, stage),
        "condition": condition_title(protocol, stage, "experimenter"),
        "is_done": is_done,
        "attempts": to_builtins(progress.of(stage)) if stage.is_trial else [],
    }


def _standing(protocol: Protocol, each: ParticipantStatus, shows_order: bool) -> dict[str, Any]:
    stage = each.next.stage
    titles = [protocol.condition(name).title for name in each.order.split(">")]
    return {
        "participant": each.participant,
        "order": titles if shows_order else [],
        "done": each.next.done,
        "total": each.next.of,
        "next": _title(protocol, stage) if stage else each.next.ended,
        "ended": stage is None,
        "has_left": each.left,
        "has_consented": each.has_consented,
        "running": each.next.running,
        "station": each.station,
        "void": each.void,
    }
