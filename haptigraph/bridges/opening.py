"""Open bridges by name: ros2, lsl, openigtlink:18944, ..."""

from collections.abc import Sequence
from contextlib import ExitStack

from haptigraph.bridges.bridge import Bridge, RunContext
from haptigraph.errors import BadInput
from haptigraph.importing import chosen

__all__ = ["BRIDGES", "open_bridges", "parse_address"]

BRIDGES = {
    "foxglove": "haptigraph.bridges.foxglove:FoxgloveLink",
    "lsl": "haptigraph.bridges.lsl:LslLink",
    "openigtlink": "haptigraph.bridges.openigtlink:OpenIgtLink",
    "ros2": "haptigraph.bridges.ros2:Ros2Link",
}


def open_bridges(names: Sequence[str], run: RunContext) -> list[Bridge]:
    """Open every bridge by NAME or NAME:ARGUMENT.

    Raises:
        BadInput: If there is no such bridge, or it cannot be opened; then all are closed.
        MissingExtra: If its library is not installed.
    """
    bridges = []
    with ExitStack() as undo:
        for name in names:
            kind, _, argument = name.partition(":")
            bridges.append(Bridge(kind, chosen(BRIDGES, "bridge", kind)(argument, run)))
            undo.callback(bridges[-1].close)
        undo.pop_all()
    return bridges


def parse_address(argument: str, bridge: str, port: int) -> tuple[str, int]:
    """Return the host and port at which a bridge's server listens: this machine only, unless a host is given.

    Args:
        argument: PORT or HOST:PORT; may be empty.
        bridge: Name of the bridge, for the error.
        port: The default port.

    Raises:
        BadInput: If the argument is neither.
    """
    if not argument:
        return "127.0.0.1", port
    host, _, text = argument.rpartition(":")
    if not text.isdecimal() or not 0 <= int(text) <= 65535:
        raise BadInput(
            f"bridge {bridge}:{argument}: expected {bridge}:PORT or {bridge}:HOST:PORT, for example "
            f"{bridge}:{port} or {bridge}:0.0.0.0:{port}"
        )
    return host.strip("[]") or "127.0.0.1", int(text)
