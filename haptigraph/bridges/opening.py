"""Open bridges by name: ros2, lsl, openigtlink:18944, ... The only place that knows them all."""

from collections.abc import Sequence
from contextlib import ExitStack
from importlib import import_module

from haptigraph.bridges.bridge import Bridge, Run
from haptigraph.errors import BadInput, unknown_name

__all__ = ["BRIDGES", "open_bridges"]

BRIDGES = {
    "foxglove": "haptigraph.bridges.foxglove:FoxgloveLink",
    "lsl": "haptigraph.bridges.lsl:LslLink",
    "openigtlink": "haptigraph.bridges.openigtlink:OpenIgtLink",
    "ros2": "haptigraph.bridges.ros2:Ros2Link",
}


def open_bridges(names: Sequence[str], run: Run) -> list[Bridge]:
    """Open every bridge; each name may carry behind a colon what the bridge takes.

    Raises:
        BadInput: If there is none of that name, or it cannot be opened; then none stays open.
        MissingExtra: If its library is not installed.
    """
    bridges = []
    with ExitStack() as undo:
        for name in names:
            kind, _, argument = name.partition(":")
            if kind not in BRIDGES:
                raise BadInput(unknown_name("bridge", kind, BRIDGES))
            module, _, link = BRIDGES[kind].partition(":")
            bridges.append(Bridge(kind, getattr(import_module(module), link)(argument, run)))
            undo.callback(bridges[-1].close)
        undo.pop_all()
    return bridges
