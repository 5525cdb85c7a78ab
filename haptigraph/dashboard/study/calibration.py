"""The calibration on the participant's page: its content, and its actions "play" and "respond".

A stimulus is played only when the participant presses a button, once, and must be played before a response.
"""

from collections.abc import Callable, Sequence
from typing import Annotated, Any

from msgspec import Meta, Struct
from starlette.routing import BaseRoute

from haptigraph.dashboard.server.json_routes import post_route
from haptigraph.dashboard.study.service import StationSite, StudyService
from haptigraph.dashboard.study.stimulus import Stimulus as Played
from haptigraph.errors import BadInput, unknown_name
from haptigraph.study.preparation.calibration import Stimulus, threshold_of
from haptigraph.study.preparation.strength import strength_of
from haptigraph.study.progress import Progress
from haptigraph.study.runner import Session

__all__ = ["Play", "Respond", "calibration_content", "calibration_text", "routes"]

Name = Annotated[str, Meta(max_length=200)]


class Play(Struct, frozen=True, forbid_unknown_fields=True):
    """Body: play the stimulus on the screen, or a pattern by its name, to learn it."""

    participant: Name
    key: Name
    number: int
    pattern: Name = ""


class Respond(Struct, frozen=True, forbid_unknown_fields=True):
    """Body: the response to the stimulus that was played."""

    participant: Name
    key: Name
    number: int
    response: Name
    page_output: Name
    """Where the page played it too."""


def calibration_content(service: StudyService, session: Session, key: str) -> dict[str, Any]:
    """Return what the participant's page shows of a calibration's task."""
    stimulus = session.stimulus(service.haptics)
    if stimulus is None:  # another stage has begun meanwhile; its status follows
        return {"number": 0, "of": 0, "round": 1, "choices": [], "may_learn": False, "played": False}
    return {
        "number": stimulus.number,
        "of": stimulus.of,
        "round": stimulus.round,
        "choices": stimulus.choices,
        "may_learn": stimulus.is_first and bool(stimulus.patterns),
        "played": service.played == _name(session, key, stimulus),
        "answer_count": stimulus.number - 1,
        "item_count": stimulus.of,
    }


def calibration_text(service: StudyService, progress: Progress) -> str:
    """Describe what the calibration has found, for the experimenter; empty: nothing yet."""
    protocol, device = service.study.protocol, service.haptics.device
    if protocol.calibration is None:
        return ""
    parts = []
    responses = progress.responses.get(("threshold", device), [])
    if responses and len(responses) >= protocol.calibration.stimuli:
        found = threshold_of(responses)
        interval = f"{found.amplitude:.3f} ({found.low:.3f} to {found.high:.3f})"
        parts.append(f"threshold {interval if found.is_known else 'unknown'}")
        parts.append(f"{found.false_alarms} of {found.catch_trials} catch trials felt")
        patterns = protocol.patterns[protocol.condition(protocol.calibration.condition).procedure]
        parts.append(strength_of(protocol.calibration, patterns, responses, service.haptics).because)
    named = progress.responses.get(("patterns", device), [])
    if named:
        parts.append(f"{sum(each.is_correct for each in named)} of {len(named)} patterns named correctly")
    return "; ".join(parts)


def routes(site: StationSite, read: Callable[[], Any]) -> Sequence[BaseRoute]:
    """Return the routes of the calibration; `read` returns the participant's status."""
    service = site.service

    def play(body: Play) -> None:
        session, stimulus = _shown(service, body.participant, body.key, body.number)
        name = _name(session, body.key, stimulus)
        if body.pattern:
            _learn(service, session, stimulus, body.pattern)
            return
        if service.played == name:
            raise BadInput("it was played already; choose an answer")
        needs_levels = not stimulus.patterns
        service.request_stimulus(session.participant, Played(name, stimulus.pattern, needs_levels))

    def respond(body: Respond) -> None:
        session, stimulus = _shown(service, body.participant, body.key, body.number)
        if service.played != _name(session, body.key, stimulus):
            raise BadInput("it was not played yet; play it first")
        with service.acting_on(body.participant) as acting:
            acting.respond(body.key, body.number, body.response, service.haptics, body.page_output)
            service.played = ""

    return [
        post_route("/participant/play", Play, play, read),
        post_route("/participant/respond", Respond, respond, read),
    ]


def _shown(service: StudyService, participant: str, key: str, number: int) -> tuple[Session, Stimulus]:
    """Return the session and its next stimulus, which must be the one on the screen."""
    session = service.session_of(participant)
    coming, stimulus = session.next().stage, session.stimulus(service.haptics)
    if coming is None or coming.key != key or stimulus is None or stimulus.number != number:
        raise BadInput(f"participant {participant}: stimulus {number} of {key} does not come next")
    return session, stimulus


def _learn(service: StudyService, session: Session, stimulus: Stimulus, name: str) -> None:
    names = [pattern.name for pattern in stimulus.patterns]
    if not stimulus.is_first:
        raise BadInput("patterns can be tried before a round, not within it")
    if name not in names:
        raise BadInput(unknown_name("pattern", name, names))
    pattern = stimulus.patterns[names.index(name)]
    service.request_stimulus(session.participant, Played(f"learn {name}", pattern))


def _name(session: Session, key: str, stimulus: Stimulus) -> str:
    return f"{session.participant} {session.number} {key} {stimulus.number}"
