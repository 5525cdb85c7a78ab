"""What the routes of all pages share."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from haptigraph.config import SourceConfig
from haptigraph.dashboard.controls import Controls
from haptigraph.dashboard.hub import Hub

if TYPE_CHECKING:
    from haptigraph.dashboard.study_desk import StudyDesk

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
    asked: SourceConfig = SourceConfig()
    """What to ask of cameras that the pages open."""
    study: "StudyDesk | None" = None
    """The station of a study, where that is what is served."""
