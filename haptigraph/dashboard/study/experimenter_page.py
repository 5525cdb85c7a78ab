"""The experimenter's routes: the status of the study, and the actions of the experimenter. JSON both ways."""

from collections.abc import Callable, Sequence
from typing import Annotated, Any

from msgspec import Meta, Struct
from starlette.routing import BaseRoute

from haptigraph.dashboard.live import page as live_page
from haptigraph.dashboard.server.json_routes import get_route, post_route
from haptigraph.dashboard.study.service import StationSite, StudyService
from haptigraph.dashboard.study.snapshots import experimenter_snapshot

__all__ = ["Enrol", "Open", "Participant", "Remark", "TrialRemark", "routes"]

Name = Annotated[str, Meta(max_length=80)]
Text = Annotated[str, Meta(max_length=4000, pattern=r"^[^\x00]*$")]


class Enrol(Struct, frozen=True, forbid_unknown_fields=True):
    """Body: enrol a participant."""

    participant: Name
    """Empty: under the next free pseudonym."""
    is_confirmed: bool = False
    """Whether to enrol although somebody enrolled here has not consented yet."""


class Open(Struct, frozen=True, forbid_unknown_fields=True):
    """Body: open a participant's session at this station."""

    participant: Name
    take_over: bool


class Participant(Struct, frozen=True, forbid_unknown_fields=True):
    """Body: a participant."""

    participant: Name


class Remark(Struct, frozen=True, forbid_unknown_fields=True):
    """Body: a text about a participant."""

    participant: Name
    text: Text


class TrialRemark(Struct, frozen=True, forbid_unknown_fields=True):
    """Body: a trial to abort or to repeat, or a calibration to skip, and why."""

    participant: Name
    key: Name
    reason: Text


def routes(site: StationSite) -> Sequence[BaseRoute]:
    """Return the experimenter's routes, and those of the live view."""
    service = site.service

    def enrol(body: Enrol) -> None:
        name = service.enrol(body.participant.strip() or None, is_confirmed=body.is_confirmed)
        service.open(name, take_over=False)

    def unenrol(body: Participant) -> None:
        service.undo_enrolment(body.participant)

    def open_session(body: Open) -> None:
        service.open(body.participant, take_over=body.take_over)

    def abort(body: TrialRemark) -> None:
        service.abort(body.participant, body.key, body.reason)

    def status() -> dict[str, Any]:
        return experimenter_snapshot(service)

    def is_blind() -> bool:
        return service.study.protocol.study.blind == "everyone"

    return [
        *live_page.routes(site, is_blind=is_blind),
        get_route("/study/status", status),
        post_route("/study/enrol", Enrol, enrol, status),
        post_route("/study/unenrol", Participant, unenrol, status),
        post_route("/study/open", Open, open_session, status),
        post_route("/study/leave", Participant, lambda body: service.leave(body.participant), status),
        post_route("/study/withdraw", Participant, lambda body: service.withdraw(body.participant), status),
        post_route("/study/abort", TrialRemark, abort, status),
        *_session_routes(service, status),
    ]


def _session_routes(service: StudyService, status: Callable[[], dict[str, Any]]) -> list[BaseRoute]:
    """Return the routes that change the session at the station."""

    def note(body: Remark) -> None:
        with service.acting_on(body.participant) as session:
            session.note(body.text)

    def stop(body: Remark) -> None:
        with service.acting_on(body.participant) as session:
            session.stop(body.text)

    def repeat(body: TrialRemark) -> None:
        with service.acting_on(body.participant) as session:
            session.repeat_trial(body.key, body.reason)

    def skip(body: TrialRemark) -> None:
        with service.acting_on(body.participant) as session:
            session.skip_calibration(body.key, body.reason)

    return [
        post_route("/study/note", Remark, note, status),
        post_route("/study/stop", Remark, stop, status),
        post_route("/study/repeat", TrialRemark, repeat, status),
        post_route("/study/skip", TrialRemark, skip, status),
    ]
