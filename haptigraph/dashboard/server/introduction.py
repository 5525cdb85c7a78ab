"""Make a hub be about a loop: its first message, its view, what moves in it."""

from collections.abc import Callable

from haptigraph.assemble import load_procedure
from haptigraph.config import Config
from haptigraph.dashboard.server.describe import describe
from haptigraph.dashboard.server.hub import Hub
from haptigraph.dashboard.server.protocol import told
from haptigraph.perception.eye_view import IoctView
from haptigraph.pipeline import Loop
from haptigraph.registration.loading import load_registration, parse_registration
from haptigraph.registration.retarget import with_target

__all__ = ["introduce"]

VIEW_PX = 560


def introduce(config: Config, loop: Loop, hub: Hub) -> Callable[[], None]:
    """Return what makes a hub be about a loop; to be called before its server starts, or in its thread.

    Args:
        config: That the loop was built by.
        loop: What is watched.
        hub: Tells the pages.

    Raises:
        BadInput: If procedure or registration cannot be used.
    """
    if config.source.registration:
        registration = load_registration(config.source.registration)
    else:
        registration = parse_registration(loop.source.registration or "", config.source.uri)
    if config.source.target_mm is not None:
        registration = with_target(registration, config.source.target_mm)
    procedure, view = load_procedure(config.run.procedure), IoctView(registration, VIEW_PX)
    moving = frozenset(entity.name for entity in procedure.schema.entities) - set(registration.anatomy)
    teleop = loop.source.teleop
    steered = {"steerable": teleop is not None, "has_jaws": teleop is not None and teleop.has_jaws}
    hello = told("hello", **describe(config, procedure, registration, view), **steered)
    return lambda: hub.introduce(hello, view, moving)
