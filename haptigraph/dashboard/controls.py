"""Who steers, and how: one page at a time, until it lets go or goes away. Everyone is told who it is."""

from msgspec import to_builtins

from haptigraph.dashboard.hub import Hub
from haptigraph.dashboard.viewer import Viewer
from haptigraph.teleop.motion import HandMotion, TeleopSettings
from haptigraph.teleop.teleop import Teleop

__all__ = ["Controls"]


class Controls:
    """Know who holds the controls.

    Args:
        hub: Tells the viewers.
        teleop: What is steered; None where nothing can be.
    """

    def __init__(self, hub: Hub, teleop: Teleop | None) -> None:
        self._hub, self._teleop = hub, teleop
        self._holder: Viewer | None = None
        self._tell_holder()
        if teleop is not None:
            self._tell_settings(teleop.settings)

    def move(self, viewer: Viewer, hand: HandMotion) -> None:
        """Move the needle as the hand at a page did; of a page that does not hold the controls, nothing."""
        if self._teleop is not None and viewer is self._holder:
            self._teleop.put(hand)

    def tune(self, viewer: Viewer, settings: TeleopSettings) -> None:
        """Change how hand becomes tool, if the page holds the controls."""
        if self._teleop is not None and viewer is self._holder:
            self._teleop.settings = settings
            self._tell_settings(settings)

    def take(self, viewer: Viewer) -> None:
        """Give the controls to a page if they are free; nobody loses them to another."""
        if self._holder is None and self._teleop is not None:
            self._holder = viewer
            self._tell_holder()

    def release(self, viewer: Viewer) -> None:
        """Free the controls if it is this page that holds them."""
        if self._holder is viewer:
            self.move(viewer, HandMotion(engaged=False))
            self._holder = None
            self._tell_holder()

    def _tell_holder(self) -> None:
        self._hub.tell("controls", lasts=True, holder=self._holder.name if self._holder else "")

    def _tell_settings(self, settings: TeleopSettings) -> None:
        self._hub.tell("settings", lasts=True, **to_builtins(settings))
