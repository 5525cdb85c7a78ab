"""Who steers: one page at a time, until it releases the controls or disconnects. All pages are notified."""

from collections.abc import Mapping

from msgspec import structs, to_builtins

from haptigraph.dashboard.server.hub import Hub
from haptigraph.dashboard.server.protocol import text_message
from haptigraph.dashboard.server.robot_control import RobotControl
from haptigraph.dashboard.server.viewer import Viewer
from haptigraph.robot.process import RobotProcess
from haptigraph.sources.phased import PhasedSource
from haptigraph.teleop.motion import HandMotion, TeleopSettings
from haptigraph.teleop.teleop import Teleop

__all__ = ["Controls"]


class Controls:
    """Grant the controls to one viewer, and pass on its input.

    Args:
        hub: Notifies the viewers.
        teleop: What is steered; None if nothing can be.
        phased: Source that is notified of the operation's phase; None if there are no phases.
        robot: A real robot, which is steered instead; None: there is none.
    """

    def __init__(
        self,
        hub: Hub,
        teleop: Teleop | None,
        phased: PhasedSource | None = None,
        robot: RobotControl | None = None,
    ) -> None:
        self._hub = hub
        self._robot = robot
        self._holder: Viewer | None = None
        self.attach(teleop, phased)

    def attach(self, teleop: Teleop | None, phased: PhasedSource | None = None) -> None:
        """Steer another run, or nothing; the holder keeps the controls.

        Args:
            teleop: As in the constructor.
            phased: As in the constructor.
        """
        self._teleop: Teleop | RobotProcess | None = self._robot.robot if self._robot else teleop
        self._phased = phased
        self._publish_holder()
        if self._teleop is not None:
            self._publish_settings(self._teleop.settings)

    def move(self, viewer: Viewer, hand: HandMotion, sent_ms: float | None = None) -> None:
        """Move the instrument as the hand at a page moved; ignored unless the page holds the controls.

        Args:
            viewer: The page.
            hand: The motion.
            sent_ms: When it was sent, in the time of messages; None: unknown.
        """
        if self._teleop is None or viewer is not self._holder:
            return
        if self._robot is not None:
            self._robot.put(hand, sent_ms)
        else:
            self._teleop.put(hand)

    def switch(self, viewer: Viewer, *, on: bool) -> None:
        """Switch a robot's motion on or off; ignored unless the page holds the controls."""
        if self._robot is not None and viewer is self._holder:
            self._robot.switch(on=on)

    def robot_refusal(self, viewer: Viewer) -> str:
        """Return why a page may not move the robot; empty if it may, or if there is none."""
        return self._robot.refusal(viewer) if self._robot else ""

    def tune(self, viewer: Viewer, changes: Mapping[str, float | bool]) -> None:
        """Change how hand motion becomes tool motion; ignored unless the page holds the controls.

        Args:
            viewer: The page.
            changes: New values by field of `TeleopSettings`; other fields keep theirs.
        """
        if self._teleop is not None and viewer is self._holder:
            self._teleop.settings = structs.replace(self._teleop.settings, **changes)
            self._publish_settings(self._teleop.settings)

    def enter_phase(self, viewer: Viewer, phase: str) -> None:
        """Enter a phase; ignored if it is unknown, the page only watches, or another holds the controls."""
        is_permitted = viewer.may_steer and (self._holder is None or self._holder is viewer)
        if is_permitted and self._phased is not None and phase in self._phased.phases:
            self._phased.named = phase

    def take(self, viewer: Viewer) -> None:
        """Give the controls to a page if they are free and it may steer."""
        if refusal := self.robot_refusal(viewer):
            viewer.put_text(text_message("error", message=refusal))
        elif viewer.may_steer and self._holder is None and self._teleop is not None:
            self._holder = viewer
            self._publish_holder()

    def release(self, viewer: Viewer) -> None:
        """Free the controls if this page holds them."""
        if self._holder is viewer:
            self.move(viewer, HandMotion(engaged=False))
            self.switch(viewer, on=False)
            self._holder = None
            self._publish_holder()

    def _publish_holder(self) -> None:
        self._hub.publish("controls", retain=True, holder=self._holder.name if self._holder else "")

    def _publish_settings(self, settings: TeleopSettings) -> None:
        self._hub.publish("settings", retain=True, **to_builtins(settings))
