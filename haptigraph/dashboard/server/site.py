"""What the routes of all pages share."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from haptigraph.config import SourceConfig
from haptigraph.dashboard.server.controls import Controls
from haptigraph.dashboard.server.hub import Hub

__all__ = ["Site"]


@dataclass(frozen=True)
class Site:
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
    asked: SourceConfig = field(default_factory=SourceConfig)
    """What to ask of cameras that the pages open."""
