"""Read where a server is to listen: PORT, or HOST:PORT for others than this machine."""

from haptigraph.errors import BadInput

__all__ = ["listening_at"]


def listening_at(argument: str, bridge: str, port: int) -> tuple[str, int]:
    """Return host and port; this machine only, unless a host is given.

    Args:
        argument: What the user gave; may be empty.
        bridge: Name of the bridge, for the error.
        port: Used if none is given.

    Raises:
        BadInput: If it is neither.
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
