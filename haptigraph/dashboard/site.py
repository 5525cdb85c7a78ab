"""What the routes of all pages share."""

from pathlib import Path
from typing import NamedTuple

from haptigraph.dashboard.controls import Controls
from haptigraph.dashboard.hub import Hub

__all__ = ["Site"]


class Site(NamedTuple):
    """What the routes of a page may use."""

    hub: Hub
    controls: Controls
    recordings: Path
    """Folder of recordings."""
