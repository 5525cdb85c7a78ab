"""The page beside a loop: what to watch it by, and a server for as long as it is watched."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from socket import socket
from urllib.parse import quote

from haptigraph.assemble import load_procedure
from haptigraph.clock import MonotonicClock
from haptigraph.config import Config
from haptigraph.dashboard.controls import Controls
from haptigraph.dashboard.describe import describe
from haptigraph.dashboard.door import LOOPBACK
from haptigraph.dashboard.health import Health
from haptigraph.dashboard.hub import Hub
from haptigraph.dashboard.server import REGISTRATION, Server, make_app
from haptigraph.dashboard.site import Site
from haptigraph.dashboard.wire import told
from haptigraph.perception.ioct import IoctView
from haptigraph.perception.registration import load_registration, parse_registration
from haptigraph.pipeline import Loop

__all__ = ["LivePage"]

VIEW_PX = 560


class LivePage:
    """Everything a run needs to be watched: give `hub` to the loop as a sink, `hub.felt` as its listener.

    Args:
        config: Of the run.
        listener: The socket to serve on.
        host: The address it listens on.
        token: What visitors must know; empty: nothing.
        recordings: Folder of recordings to show.
    """

    def __init__(self, config: Config, listener: socket, *, host: str, token: str, recordings: Path) -> None:
        self.hub = Hub(MonotonicClock())
        self._config, self._listener, self._host, self._token = config, listener, host, token
        self._recordings = recordings

    @property
    def address(self) -> str:
        """What to open in a browser."""
        host = f"[{self._host}]" if ":" in self._host else self._host
        secret = f"?token={quote(self._token)}" if self._token else ""
        return f"http://{host}:{self._listener.getsockname()[1]}/{secret}"

    @contextmanager
    def served(self, loop: Loop) -> Iterator[None]:
        """Serve the page while the context lasts.

        Args:
            loop: What is watched.

        Raises:
            BadInput: If procedure or registration cannot be used.
        """
        config = self._config
        if config.source.registration:
            registration = load_registration(config.source.registration)
        else:
            registration = parse_registration(loop.source.registration or "", config.source.uri)
        procedure, view = load_procedure(config.run.procedure), IoctView(registration, VIEW_PX)
        moving = frozenset(entity.name for entity in procedure.schema.entities) - set(registration.anatomy)
        teleop = getattr(loop.source, "teleop", None)
        hello = describe(config, procedure, registration, view)
        self.hub.introduce(told("hello", **hello, steerable=teleop is not None), view, moving)
        site = self._site(Controls(self.hub, teleop))
        app = make_app(site, Health(loop, self.hub), host=self._host, token=self._token)
        with Server(app, self._listener):
            yield

    def registered_first(self) -> str:
        """Serve the registration page alone until somebody saves there; return the file's path."""
        saved: SimpleQueue[str] = SimpleQueue()
        controls = Controls(self.hub, None)
        site = self._site(controls, saved.put)
        app = make_app(site, dict, host=self._host, token=self._token, pages=(REGISTRATION,))
        with Server(app, self._listener.dup()):
            return saved.get()

    def _site(self, controls: Controls, on_registration: Callable[[str], None] | None = None) -> Site:
        is_local = self._host in LOOPBACK
        return Site(self.hub, controls, self._config.source.uri, self._recordings, is_local, on_registration)

    def end(self, reason: str) -> None:
        """Tell the viewers that the run has ended, and why."""
        self.hub.tell_from_outside("ended", reason=reason)

    def wait(self) -> None:
        """Wait until Ctrl-C."""
        threading.Event().wait()
