"""What the routes of all pages share."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from haptigraph.dashboard.controls import Controls
from haptigraph.dashboard.hub import Hub

__all__ = ["Site"]


class Site(NamedTuple):
    """What the routes of a page may use."""

    hub: Hub
    controls: Controls
    source: str
    """What the loop runs on, or would."""
    recordings: Path
    """Folder of recordings."""
    is_local: bool
    """Whether only this machine can reach the pages."""
    on_registration: Callable[[str], None] | None = None
    """Starts the loop with a registration, where it waits for one."""
