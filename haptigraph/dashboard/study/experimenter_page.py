"""The experimenter's routes: where everyone stands, and what only the experimenter does. JSON both ways."""

from collections.abc import Sequence
from typing import Annotated, Any

from msgspec import Meta, Struct
from starlette.routing import BaseRoute

from haptigraph.dashboard.live import page as live_page
from haptigraph.dashboard.server.answers import acting, asking
from haptigraph.dashboard.study.service import StationSite
from haptigraph.dashboard.study.views import experimenter_view

__all__ = ["At", "Ended", "Enrol", "Open", "Saying", "routes"]

Name = Annotated[str, Meta(max_length=80)]
Words = Annotated[str, Meta(max_length=4000, pattern=r"^[^\x00]*$")]


class Enrol(Struct, frozen=True, forbid_unknown_fields=True):
    """Take someone in."""

    participant: Name
    """Empty: the next free pseudonym."""


class Open(Struct, frozen=True, forbid_unknown_fields=True):
    """Bring a participant here."""

    participant: Name
    take_over: bool


class At(Struct, frozen=True, forbid_unknown_fields=True):
    """Whom it is about."""

    participant: Name


class Saying(Struct, frozen=True, forbid_unknown_fields=True):
    """Something about a participant, in words."""

    participant: Name
    text: Words


class Ended(Struct, frozen=True, forbid_unknown_fields=True):
    """A trial that shall end, or be done again, and why."""

    participant: Name
    key: Name
    reason: Words


def routes(site: StationSite) -> Sequence[BaseRoute]:
    """Return the experimenter's routes, and those of the live view."""
    service = site.service

    def enrol(wish: Enrol) -> None:
        service.open(service.enrol(wish.participant.strip() or None), take_over=False)

    def note(wish: Saying) -> None:
        with service.acting(wish.participant) as session:
            session.note(wish.text)

    def stop(wish: Saying) -> None:
        with service.acting(wish.participant) as session:
            session.stop(wish.text)

    def repeat(wish: Ended) -> None:
        with service.acting(wish.participant) as session:
            session.repeat_trial(wish.key, wish.reason)

    def now() -> dict[str, Any]:
        return experimenter_view(service)

    return [
        *live_page.routes(site),
        asking("/study/now", now),
        acting("/study/enrol", Enrol, enrol, now),
        acting(
            "/study/open", Open, lambda wish: service.open(wish.participant, take_over=wish.take_over), now
        ),
        acting("/study/leave", At, lambda wish: service.leave(wish.participant), now),
        acting("/study/withdraw", At, lambda wish: service.withdraw(wish.participant), now),
        acting("/study/note", Saying, note, now),
        acting("/study/stop", Saying, stop, now),
        acting("/study/repeat", Ended, repeat, now),
        acting(
            "/study/abort", Ended, lambda wish: service.abort(wish.participant, wish.key, wish.reason), now
        ),
    ]
