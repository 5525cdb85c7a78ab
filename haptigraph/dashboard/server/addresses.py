"""The addresses of a page that a browser can open, also on other computers, and their QR codes."""

import io
from collections.abc import Iterator
from ipaddress import ip_address
from socket import socket
from urllib.parse import quote

import ifaddr
import segno

__all__ = ["address_lines", "addresses", "qr_code"]

ANY = ("0.0.0.0", "::")  # listens on all addresses, and is none itself


def addresses(listener: socket, host: str, token: str, path: str = "/") -> list[str]:
    """Return the addresses to open in a browser; several if the server listens on all of the machine's.

    Args:
        listener: The listening socket.
        host: Address it listens on, as the user gave it.
        token: What visitors must present; empty: nothing.
        path: Of the page.
    """
    names = _own_names(host) if host in ANY else [host]
    secret = f"?token={quote(token)}" if token else ""
    port = listener.getsockname()[1]
    return [f"http://{f'[{name}]' if ':' in name else name}:{port}{path}{secret}" for name in names]


def address_lines(opened: list[str], what: str, whom: str = "") -> list[str]:
    """Return the sentences that name a page's addresses: what the page is, and for whom."""
    return [f"haptigraph: {'or ' * (number > 0)}{what} {each}{whom}" for number, each in enumerate(opened)]


def qr_code(address: str) -> str:
    """Return an address as a QR code of block characters, for terminals with a dark background."""
    text = io.StringIO()
    segno.make(address, micro=False).terminal(text, compact=True)
    return text.getvalue()


def _own_names(host: str) -> list[str]:
    """Return the machine's addresses that other machines can open; its own if there is none."""
    return list(_reachable(accepts_ipv6=host == "::")) or ["127.0.0.1"]


def _reachable(*, accepts_ipv6: bool) -> Iterator[str]:
    for adapter in ifaddr.get_adapters():
        for ip in adapter.ips:
            name = ip.ip if isinstance(ip.ip, str) else ip.ip[0]  # of IPv6: address, flow, scope
            at = ip_address(name)
            if not (at.is_loopback or at.is_link_local) and (ip.is_IPv4 or accepts_ipv6):
                yield name
