"""The participant's routes: the stage that comes next, and what the participant does in it. JSON both ways.

Every act names participant and stage on the screen; what does not come next is refused, so that neither a
second click nor another participant's page does anything.
"""

from collections.abc import Sequence
from typing import Annotated, Any

from msgspec import Meta, Struct
from starlette.routing import BaseRoute

from haptigraph.dashboard.server.answers import acting, asking
from haptigraph.dashboard.study.service import StationSite
from haptigraph.dashboard.study.views import participant_view

__all__ = ["Answer", "Here", "routes"]

Name = Annotated[str, Meta(max_length=200)]


class Here(Struct, frozen=True, forbid_unknown_fields=True):
    """The stage on the screen."""

    participant: Name
    key: Name


class Answer(Struct, frozen=True, forbid_unknown_fields=True):
    """An answer; empty: it is taken back."""

    participant: Name
    key: Name
    item: Name
    answer: Annotated[str, Meta(max_length=20_000)]


def routes(site: StationSite) -> Sequence[BaseRoute]:
    """Return the participant's routes."""
    service = site.service

    def answer(wish: Answer) -> None:
        with service.acting(wish.participant) as session:
            if wish.answer.strip():
                session.answer(wish.key, wish.item, wish.answer)
            else:
                session.take_back(wish.key, wish.item)

    def done(wish: Here) -> None:
        with service.acting(wish.participant) as session:
            session.done(wish.key)

    def now() -> dict[str, Any]:
        return participant_view(service)

    return [
        asking("/participant/now", now),
        acting("/participant/answer", Answer, answer, now),
        acting("/participant/done", Here, done, now),
        acting("/participant/begin", Here, lambda wish: service.begin(wish.participant, wish.key), now),
        acting("/participant/ready", Here, lambda wish: service.ready(wish.participant, wish.key), now),
    ]
