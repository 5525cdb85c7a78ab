"""The live page beside a loop: a hub to watch it and a server."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from socket import socket

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.clock import MonotonicClock
from haptigraph.config import Config
from haptigraph.dashboard.server.access import LOOPBACK, Tokens
from haptigraph.dashboard.server.addresses import address_lines, addresses, qr_code
from haptigraph.dashboard.server.controls import Controls
from haptigraph.dashboard.server.describe import announcement
from haptigraph.dashboard.server.health import Health
from haptigraph.dashboard.server.hub import Hub
from haptigraph.dashboard.server.robot_control import RobotControl
from haptigraph.dashboard.server.server import REGISTRATION, Server, make_app
from haptigraph.dashboard.server.site import Site
from haptigraph.pipeline import Loop
from haptigraph.robot.preparing import enable_and_home
from haptigraph.run_robot import SteeredRobot
from haptigraph.sources.phased import PhasedSource

__all__ = ["LivePage"]


class LivePage:
    """Serve a run: give `hub` to the loop as a sink and `hub.record_level` as its listener.

    Args:
        config: Of the run.
        listener: The socket to serve on.
        host: The address it listens on.
        tokens: What visitors must present.
        recordings: Folder of recordings to show.
        allows_remote_motion: Whether pages on other machines may move a robot.
        homes: Whether a robot is enabled and homed before pages are served; it may move by itself meanwhile.
    """

    def __init__(
        self,
        config: Config,
        listener: socket,
        *,
        host: str,
        tokens: Tokens,
        recordings: Path,
        allows_remote_motion: bool = False,
        homes: bool = False,
    ) -> None:
        self.hub = Hub(MonotonicClock())
        self._allows_remote_motion, self._homes = allows_remote_motion, homes
        self._config, self._listener, self._host, self._tokens = config, listener, host, tokens
        self._recordings = recordings

    @property
    def address(self) -> str:
        """The address to open in a browser on this machine or, with another host, on others."""
        return addresses(self._listener, self._host, self._tokens.steer)[0]

    @property
    def recordings_address(self) -> str:
        """Where this machine's browser finds the recordings."""
        return addresses(self._listener, self._host, self._tokens.steer, "/recordings")[0]

    @property
    def address_lines(self) -> list[str]:
        """What to print: the addresses to steer and, for other machines, to watch."""
        steer = addresses(self._listener, self._host, self._tokens.steer)
        lines = address_lines(steer, "the page is at")
        if self._tokens.watch:
            lines += address_lines(self._to_watch, "to watch only:")
        return lines

    @property
    def qr_codes(self) -> list[tuple[str, str]]:
        """Role and QR code of the addresses for other machines; none if only this one can reach the page."""
        if not self._tokens.watch:
            return []
        return [("watch", qr_code(self._to_watch[0])), ("steer", qr_code(self.address))]

    @property
    def _to_watch(self) -> list[str]:
        return addresses(self._listener, self._host, self._tokens.watch)

    @contextmanager
    def served(self, loop: Loop, measures: RunMeasures) -> Iterator[None]:
        """Serve the pages while the context lasts.

        Args:
            loop: The loop to watch.
            measures: Of its run, kept up to date by the consumer of its steps.

        Raises:
            BadInput: If procedure or registration cannot be used.
        """
        announcement(self._config, loop, self.hub)()
        phased = loop.source if isinstance(loop.source, PhasedSource) else None
        robot = self._robot_control(loop)
        site = self._site(Controls(self.hub, loop.source.teleop, phased, robot))
        health, pump = Health(loop, self.hub, measures), robot.pump if robot else None
        app = make_app(site, health, host=self._host, tokens=self._tokens, pump=pump)
        with Server(app, self._listener):
            yield

    def wait_for_registration(self) -> str:
        """Serve the registration page alone until a registration is saved there; return the file's path."""
        saved: SimpleQueue[str] = SimpleQueue()
        controls = Controls(self.hub, None)
        site = self._site(controls, saved.put)
        app = make_app(site, dict, host=self._host, tokens=self._tokens, pages=(REGISTRATION,))
        with Server(app, self._listener.dup()):
            return saved.get()

    def _robot_control(self, loop: Loop) -> RobotControl | None:
        if not isinstance(loop.robot, SteeredRobot):
            return None
        if self._homes:
            enable_and_home(loop.robot.process, MonotonicClock())
        return RobotControl(self.hub, loop.robot, allows_remote=self._allows_remote_motion)

    def _site(self, controls: Controls, on_registration: Callable[[str], None] | None = None) -> Site:
        is_local, source = self._host in LOOPBACK, self._config.source
        return Site(self.hub, controls, source.uri, self._recordings, is_local, on_registration, source)

    def end(self, reason: str) -> None:
        """Notify the viewers that the run has ended, and why."""
        self.hub.publish_threadsafe("ended", reason=reason)

    def wait(self) -> None:
        """Wait until Ctrl-C."""
        threading.Event().wait()
