"""The participant's routes: the next stage, and the participant's actions in it. JSON both ways.

Every request names the participant and the stage on the screen. If another stage comes next, it is refused,
so that neither a second click nor another participant's page has an effect.
"""

from collections.abc import Sequence
from typing import Annotated, Any

from msgspec import Meta, Struct
from starlette.routing import BaseRoute

from haptigraph.dashboard.live import page as live_page
from haptigraph.dashboard.server.json_routes import get_route, post_route
from haptigraph.dashboard.study import calibration
from haptigraph.dashboard.study.service import StationSite
from haptigraph.dashboard.study.snapshots import participant_snapshot

__all__ = ["Answer", "CurrentStage", "Felt", "routes"]

Name = Annotated[str, Meta(max_length=200)]


class CurrentStage(Struct, frozen=True, forbid_unknown_fields=True):
    """Body: the stage on the screen."""

    participant: Name
    key: Name


class Answer(Struct, frozen=True, forbid_unknown_fields=True):
    """Body: an answer to an item; an empty one removes it."""

    participant: Name
    key: Name
    item: Name
    answer: Annotated[str, Meta(max_length=20_000)]


class Felt(Struct, frozen=True, forbid_unknown_fields=True):
    """Body: whether the test pulse before a trial was felt."""

    participant: Name
    key: Name
    is_felt: bool


def routes(site: StationSite) -> Sequence[BaseRoute]:
    """Return the participant's routes."""
    service = site.service

    def answer(body: Answer) -> None:
        with service.acting_on(body.participant) as session:
            if body.answer.strip():
                session.answer(body.key, body.item, body.answer)
            else:
                session.clear_answer(body.key, body.item)

    def done(body: CurrentStage) -> None:
        with service.acting_on(body.participant) as session:
            session.done(body.key)

    def begin(body: CurrentStage) -> None:
        service.begin(body.participant, body.key)

    def pulse(body: CurrentStage) -> None:
        service.play_pulse(body.participant, body.key)

    def felt(body: Felt) -> None:
        service.answer_pulse(body.participant, body.key, is_felt=body.is_felt)

    def ready(body: CurrentStage) -> None:
        service.ready(body.participant, body.key)

    def status() -> dict[str, Any]:
        return participant_snapshot(service)

    return [
        *live_page.routes(site, "/participant/live", "participant's page"),
        get_route("/participant/status", status),
        post_route("/participant/answer", Answer, answer, status),
        post_route("/participant/done", CurrentStage, done, status),
        post_route("/participant/pulse", CurrentStage, pulse, status),
        post_route("/participant/felt", Felt, felt, status),
        post_route("/participant/begin", CurrentStage, begin, status),
        post_route("/participant/ready", CurrentStage, ready, status),
        *calibration.routes(site, status),
    ]
