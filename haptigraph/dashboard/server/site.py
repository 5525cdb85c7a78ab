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
    """Context of a page's routes."""

    hub: Hub
    controls: Controls
    source: str
    """Source of the loop that runs, or that waits for a registration."""
    recordings: Path
    """Folder of recordings."""
    is_local: bool
    """Whether only this machine can reach the pages."""
    on_registration: Callable[[str], None] | None = None
    """Starts a loop that waits for a registration, with the file's path; None if none waits."""
    source_config: SourceConfig = field(default_factory=SourceConfig)
    """Settings of cameras that pages open."""
