"""The server of a study's pages, and what they show while a trial runs."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from socket import socket
from typing import Any

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.clock import MonotonicClock
from haptigraph.config import Config
from haptigraph.dashboard.server.access import LOOPBACK, Tokens
from haptigraph.dashboard.server.addresses import addresses
from haptigraph.dashboard.server.controls import Controls
from haptigraph.dashboard.server.describe import announcement
from haptigraph.dashboard.server.health import Health
from haptigraph.dashboard.server.hub import Hub
from haptigraph.dashboard.server.server import STUDY_PAGES, Server, make_app
from haptigraph.dashboard.study.service import StationSite, StudyService
from haptigraph.dashboard.study.touch_output import TouchOutput
from haptigraph.pipeline import Loop
from haptigraph.sources.phased import PhasedSource

__all__ = ["StudySite"]


class StudySite:
    """Serve a study's pages.

    Args:
        service: The station's service.
        base: The station's configuration.
        listener: The socket to serve on.
        host: The address it listens on.
        token: What visitors must present; empty: nothing.
    """

    def __init__(
        self, service: StudyService, base: Config, listener: socket, *, host: str, token: str
    ) -> None:
        self.hub = Hub(MonotonicClock())
        """Give it to the loop of a trial as a sink, and `hub.record_level` as its listener."""
        self._service, self._base, self._listener = service, base, listener
        self._host, self._token = host, token
        self._controls = Controls(self.hub, None)
        service.touch = TouchOutput(
            base.haptics, self.hub.viewers, self.hub.record_level, self.hub.keep_alive
        )
        self._health: Health | None = None

    def addresses(self, path: str = "/") -> list[str]:
        """Return the addresses of a page to open in a browser."""
        return addresses(self._listener, self._host, self._token, path)

    @contextmanager
    def served(self) -> Iterator[None]:
        """Serve the pages while the context lasts."""
        folder = self._service.study.protocol.folder / "recordings"
        site = StationSite(
            self.hub,
            self._controls,
            self._base.source.uri,
            folder,
            self._host in LOOPBACK,
            source_config=self._base.source,
            service=self._service,
        )
        self._service.on_change = self._notify
        self.hub.on_outputs = self._service.notify
        app = make_app(
            site, self._read_health, host=self._host, tokens=Tokens(self._token), pages=STUDY_PAGES
        )
        with Server(app, self._listener):
            yield

    def prepare(self, config: Config, loop: Loop, measures: RunMeasures) -> Callable[[], None]:
        """Return a function that makes the pages show a loop; call it before the loop's first step.

        Raises:
            BadInput: If procedure or registration cannot be used.
        """
        announce = announcement(config, loop, self.hub)
        phased = loop.source if isinstance(loop.source, PhasedSource) else None
        teleop = loop.source.teleop

        def show() -> None:
            self._health, self.hub.deliveries = Health(loop, self.hub, measures), loop.deliveries
            self.hub.call_threadsafe(announce)
            self.hub.call_threadsafe(lambda: self._controls.attach(teleop, phased))

        return show

    def end(self) -> None:
        """Notify the pages that the loop has ended."""
        self._health = None
        self.hub.call_threadsafe(lambda: self._controls.attach(None))
        self.hub.publish_threadsafe("ended", reason="The trial is over.")

    def _notify(self) -> None:
        version = self._service.version
        self.hub.call_threadsafe(lambda: self.hub.publish("study", version=version))

    def _read_health(self) -> dict[str, Any]:
        health = self._health
        return health() if health else {}
