"""Who steers: one page at a time, until it lets go or goes away. Everyone is told who it is."""

from haptigraph.dashboard.hub import Hub
from haptigraph.dashboard.viewer import Viewer

__all__ = ["Controls"]


class Controls:
    """Know who holds the controls.

    Args:
        hub: Tells the viewers.
    """

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._holder: Viewer | None = None
        self._tell()

    def holds(self, viewer: Viewer) -> bool:
        """Tell whether a page holds the controls."""
        return viewer is self._holder

    def take(self, viewer: Viewer) -> None:
        """Give the controls to a page if they are free; nobody loses them to another."""
        if self._holder is None:
            self._holder = viewer
            self._tell()

    def release(self, viewer: Viewer) -> None:
        """Free the controls if it is this page that holds them."""
        if self._holder is viewer:
            self._holder = None
            self._tell()

    def _tell(self) -> None:
        self._hub.tell("controls", lasts=True, holder=self._holder.name if self._holder else "")
