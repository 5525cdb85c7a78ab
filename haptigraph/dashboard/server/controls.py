"""Who steers, and how: one page at a time, until it lets go or goes away. Everyone is told who it is."""

from collections.abc import Mapping

from msgspec import structs, to_builtins

from haptigraph.dashboard.server.hub import Hub
from haptigraph.dashboard.server.viewer import Viewer
from haptigraph.sources.phased import PhasedSource
from haptigraph.teleop.motion import HandMotion, TeleopSettings
from haptigraph.teleop.teleop import Teleop

__all__ = ["Controls"]


class Controls:
    """Know who holds the controls.

    Args:
        hub: Tells the viewers.
        teleop: What is steered; None where nothing can be.
        phased: Where the operation has phases: what is told which one it enters.
    """

    def __init__(self, hub: Hub, teleop: Teleop | None, phased: PhasedSource | None = None) -> None:
        self._hub = hub
        self._holder: Viewer | None = None
        self.begin(teleop, phased)

    def begin(self, teleop: Teleop | None, phased: PhasedSource | None = None) -> None:
        """Steer something else from now on, or nothing; whoever holds the controls keeps them.

        Args:
            teleop: As when made.
            phased: The same.
        """
        self._teleop, self._phased = teleop, phased
        self._tell_holder()
        if teleop is not None:
            self._tell_settings(teleop.settings)

    def move(self, viewer: Viewer, hand: HandMotion) -> None:
        """Move the needle as the hand at a page did; of a page that does not hold the controls, nothing."""
        if self._teleop is not None and viewer is self._holder:
            self._teleop.put(hand)

    def tune(self, viewer: Viewer, changes: Mapping[str, float | bool]) -> None:
        """Change how hand becomes tool, if the page holds the controls.

        Args:
            viewer: The page.
            changes: Fields of `TeleopSettings` and their new values; the others stay.
        """
        if self._teleop is not None and viewer is self._holder:
            self._teleop.settings = structs.replace(self._teleop.settings, **changes)
            self._tell_settings(self._teleop.settings)

    def enter(self, viewer: Viewer, phase: str) -> None:
        """Enter a phase of the operation, if there is such a one and no other page holds the controls."""
        may = self._holder is None or self._holder is viewer
        if may and self._phased is not None and phase in self._phased.phases:
            self._phased.named = phase

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
