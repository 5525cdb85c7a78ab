"""How a study is told to its pages: all but what blinding hides to one, one stage to the other.

Turns what the store holds into what JSON can hold. Changes nothing.
"""

import time
from typing import Any, Literal, TypeAlias

from msgspec import to_builtins

from haptigraph.dashboard.study.service import StudyService
from haptigraph.study.plan import Stage, condition_title
from haptigraph.study.progress import Next, Progress, read_progress, repeatable
from haptigraph.study.protocol import Protocol
from haptigraph.study.runner import Session
from haptigraph.study.standing import Standing, events_of, standings

__all__ = ["experimenter_view", "participant_view"]

Reader: TypeAlias = Literal["participant", "experimenter"]
TITLES = {"briefing": "Briefing", "consent": "Consent", "break": "Break", "thanks": "Thanks"}


def participant_view(service: StudyService) -> dict[str, Any]:
    """Return what the participant's page shows: who, the stage that comes next, and what its trial does."""
    session = service.here()
    content: dict[str, Any] = {**_about(service), "participant": session.participant if session else ""}
    if session is None:
        return content
    coming, protocol = session.next(), service.study.protocol
    content |= {"done": coming.done, "of": coming.of, "ended": coming.ended, "thanks": protocol.texts.thanks}
    if coming.stage is not None:
        content["stage"] = _stage(protocol, coming.stage, coming, "participant") | _shown(
            protocol, coming.stage, coming
        )
    return content


def experimenter_view(service: StudyService) -> dict[str, Any]:
    """Return what the experimenter's page shows: who is here and how far, and where all others stand."""
    session, study = service.here(), service.study
    is_open = study.protocol.study.blind != "everyone"
    return {
        **_about(service),
        "name": study.name,
        "station": service.station,
        "most": study.protocol.study.participants,
        "shows_all": is_open,
        "problem": service.problem,
        "elapsed_s": (time.monotonic_ns() - service.begun_ns) / 1e9 if service.begun_ns else None,
        "here": _here(service, session) if session else None,
        "participants": [_standing(study.protocol, each, is_open) for each in standings(study)],
    }


def _about(service: StudyService) -> dict[str, Any]:
    return {
        "version": service.version,
        "title": service.study.protocol.study.title,
        "simulated": service.study.simulated,
        "doing": service.doing,
        "trouble": bool(service.problem),
    }


def _here(service: StudyService, session: Session) -> dict[str, Any]:
    study = service.study
    with study.store.begin() as connection:
        progress = read_progress(connection, study.name, session.participant)
    coming = session.next()
    again = repeatable(session.plan, progress, coming)
    trial = coming.stage if coming.stage and coming.stage.is_trial else None
    tells = trial is not None and study.protocol.study.blind != "everyone"
    return {
        "is_felt": not (trial and tells) or study.protocol.condition(trial.condition).touch,
        "participant": session.participant,
        "done": coming.done,
        "of": coming.of,
        "ended": coming.ended,
        "stage": _stage(study.protocol, coming.stage, coming, "experimenter") if coming.stage else None,
        "repeatable": again.key if again else "",
        "plan": [
            _planned(study.protocol, stage, progress, number < coming.done)
            for number, stage in enumerate(session.plan)
        ],
        "events": to_builtins(events_of(study, session.participant)),
    }


def _stage(protocol: Protocol, stage: Stage, coming: Next, reader: Reader) -> dict[str, Any]:
    """Say which stage it is, in words that a reader may know."""
    return {
        "key": stage.key,
        "kind": stage.kind,
        "title": _title(protocol, stage),
        "condition": condition_title(protocol, stage, reader),
        "attempt": coming.attempt,
        "running": coming.running,
        "timeout_s": stage.timeout_s,
        "free": stage.free,
        "answered": len(coming.answers),
        "asked": len(protocol.questionnaire(stage.questionnaire).items) if stage.questionnaire else 0,
    }


def _shown(protocol: Protocol, stage: Stage, coming: Next) -> dict[str, Any]:
    """Return what only the participant's page needs of a stage: its texts, items and answers."""
    texts = protocol.texts
    words = {"briefing": texts.briefing, "consent": texts.consent, "break": texts.break_text}
    words["thanks"] = texts.thanks
    if stage.kind in words:
        return {"text": words[stage.kind]}
    if stage.is_trial:
        return {"display": protocol.condition(stage.condition).display}
    sheet = protocol.questionnaire(stage.questionnaire)
    items = [{**to_builtins(item), "valid": item.valid} for item in sheet.items]
    return {"intro": sheet.intro, "source": sheet.source, "items": items, "answers": dict(coming.answers)}


def _title(protocol: Protocol, stage: Stage) -> str:
    if stage.kind == "questionnaire":
        return protocol.questionnaire(stage.questionnaire).title
    if not stage.is_trial:
        return TITLES[stage.kind]
    if stage.kind == "training":
        number, count = stage.trial, protocol.training.trials if protocol.training else 1
    else:
        each = protocol.trials.repetitions
        number, count = (stage.block - 1) * each + stage.trial, each * protocol.trials.blocks
    what = stage.kind.capitalize()
    return what if count == 1 else f"{what} {number} of {count}"


def _planned(protocol: Protocol, stage: Stage, progress: Progress, is_behind: bool) -> dict[str, Any]:
    return {
        "key": stage.key,
        "title": _title(protocol, stage),
        "condition": condition_title(protocol, stage, "experimenter"),
        "is_behind": is_behind,
        "attempts": to_builtins(progress.of(stage)) if stage.is_trial else [],
    }


def _standing(protocol: Protocol, each: Standing, shows_order: bool) -> dict[str, Any]:
    stage = each.next.stage
    titles = [protocol.condition(name).title for name in each.order.split(">")]
    return {
        "participant": each.participant,
        "order": titles if shows_order else [],
        "done": each.next.done,
        "of": each.next.of,
        "next": _title(protocol, stage) if stage else each.next.ended,
        "ended": stage is None,
        "left": each.left,
        "running": each.next.running,
        "station": each.station,
        "void": each.void,
    }
