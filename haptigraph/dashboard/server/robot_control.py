"""The real robot that pages steer: who may, its enable switch, and its state on every page.

It moves only while the page that has the controls holds its dead-man, which sends many messages per second.
The robot's own process holds it when they cease, so nothing here needs to run for that.
"""

import asyncio

from haptigraph.dashboard.server.hub import Hub
from haptigraph.dashboard.server.viewer import Viewer
from haptigraph.robot.process import RobotProcess
from haptigraph.run_robot import SteeredRobot
from haptigraph.teleop.motion import HandMotion

__all__ = ["RobotControl"]

PUBLISH_S = 0.1
RELEASED = HandMotion(engaged=False)
ELSEWHERE = (
    "this page cannot move the robot: open it in a browser on the machine that runs haptigraph, at "
    "127.0.0.1, or start haptigraph with --allow-remote-motion"
)


class RobotControl:
    """Steer one robot for the pages. Used in the server's thread.

    Args:
        hub: Notifies the viewers, and has the clock of their messages.
        robot: The robot; a motion that was sent more than its dead-man time ago is not carried out.
        allows_remote: Whether pages on other machines may move it.
    """

    def __init__(self, hub: Hub, robot: SteeredRobot, *, allows_remote: bool = False) -> None:
        self.robot: RobotProcess = robot.process
        self._hub, self._deadman_ms, self._allows_remote = hub, robot.setup.limits.deadman_ms, allows_remote
        self._late = 0

    def refusal(self, viewer: Viewer) -> str:
        """Return why a page may not move the robot; empty if it may."""
        return "" if viewer.is_local or self._allows_remote else ELSEWHERE

    def put(self, hand: HandMotion, sent_ms: float | None) -> None:
        """Pass on the motion of a hand; one that was delayed, or of unknown age, is taken as a release."""
        is_timely = sent_ms is not None and abs(self._hub.now_ms() - sent_ms) <= self._deadman_ms
        self._late += hand.engaged and not is_timely
        self.robot.put(hand if is_timely else RELEASED)

    def switch(self, *, on: bool) -> None:
        """Switch motion on or off."""
        self.robot.put(RELEASED)
        self.robot.set_enabled(on)

    async def pump(self) -> None:
        """Publish the robot's state until cancelled."""
        while True:
            if self._hub.viewers:
                self._publish()
            await asyncio.sleep(PUBLISH_S)

    def _publish(self) -> None:
        status = self.robot.status()
        reading = status.reading
        operating = reading.operating if reading else None
        self._hub.publish(
            "robot",
            uri=self.robot.uri,
            is_moving=status.is_moving,
            is_switched_on=status.is_switched_on,
            reasons=status.reasons,
            state=operating.state if operating else "",
            is_homed=operating.is_homed if operating else False,
            tip_mm=reading.pose.position_mm if reading and reading.pose else None,
            rate_hz=round(status.rate_hz, 1),
            late=self._late,
            error=status.error,
        )
