"""Access control: check host, origin and token of requests, and add security headers to responses.

A page from elsewhere, open in the same browser, can neither read from this server nor steer.
"""

import hmac
import re
from collections.abc import Mapping
from http.cookies import SimpleCookie
from ipaddress import ip_address
from typing import Any, NamedTuple
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["LOOPBACK", "AccessControl", "Tokens", "is_local", "may_steer"]

LOOPBACK = ("127.0.0.1", "localhost", "::1")
COOKIE = "haptigraph_token"
HOST = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[^\s,:@/]+)(?::\d{1,5})?")
SAFE_METHODS = ("GET", "HEAD")
FORWARDING = ("forwarded", "via", "x-forwarded-for", "x-forwarded-host", "x-real-ip")
"""Headers that proxies add. They make a sender remote, and never local: anybody can send them."""
WATCHED = re.compile(r"/|/live|/static/.*")
"""Paths that visitors may open who only watch."""
MAY_STEER = "haptigraph.may_steer"
"""Key of a request's scope."""
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'self' ws://{host}; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)


class Tokens(NamedTuple):
    """What visitors must present. Empty: nobody has this role by a token."""

    steer: str = ""
    """To do everything; empty: every visitor may."""
    watch: str = ""
    """To watch the live page."""


def may_steer(scope: Mapping[str, Any]) -> bool:
    """Return whether the sender of a request that was passed on may do more than watch."""
    return bool(scope[MAY_STEER])


def is_local(scope: Mapping[str, Any]) -> bool:
    """Return whether a request comes from a program on this machine, and not through a proxy on it."""
    if scope["client"] is None or any(
        name.decode("latin-1").lower() in FORWARDING for name, _ in scope["headers"]
    ):
        return False
    address = ip_address(scope["client"][0])
    return (getattr(address, "ipv4_mapped", None) or address).is_loopback


class AccessControl:
    """ASGI middleware that passes on permitted requests only.

    Args:
        app: The protected app.
        host: The address that the server listens on; loopback addresses need no token.
        tokens: What visitors must present.
        entrances: Paths of pages that other sites may link to.
    """

    def __init__(
        self, app: ASGIApp, *, host: str, tokens: Tokens, entrances: frozenset[str] = frozenset()
    ) -> None:
        self._app, self._host, self._tokens, self._entrances = app, host, tokens, entrances

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse one request, or pass it on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        token = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        refusal = self._refusal(scope, headers, token)
        if refusal:
            await _refuse(refusal, scope, receive, send)
        elif token and self._tokens.steer and scope["type"] == "http":
            # The token moves from the address, which is shown and shared, into a cookie.
            response = RedirectResponse(scope["path"], status_code=303)
            response.set_cookie(COOKIE, token, httponly=True, samesite="strict")
            await response(scope, receive, send)
        else:
            scope = {**scope, MAY_STEER: self._may_steer(token or _cookie(headers))}
            await self._app(scope, receive, _with_headers(send, headers.get("host", "")))

    def _refusal(self, scope: Scope, headers: Headers, token: str) -> str:
        """Return why a request is refused; empty if it is permitted."""
        host = headers.get("host", "")
        match = HOST.fullmatch(host)
        if match is None:
            return "the Host header is not one host name with or without port"
        name = match[1].strip("[]")
        if self._host in LOOPBACK and name not in LOOPBACK:
            return f"this server answers requests for {self._host} only, not for {name or 'an empty host'}"
        origin = headers.get("origin")
        is_safe = scope["type"] == "http" and scope["method"] in SAFE_METHODS
        if origin is not None and origin != f"http://{host}" and not is_safe:
            return f"requests from pages of {origin} are not permitted"
        site = headers.get("sec-fetch-site", "none")
        if site not in ("none", "same-origin") and scope["path"] not in self._entrances:
            return "requests from pages of other sites are not permitted"
        if origin is None and not is_safe:
            return "request without Origin; only scripts of this server's own pages may send it"
        return self._role_refusal(scope, token or _cookie(headers))

    def _role_refusal(self, scope: Scope, token: str) -> str:
        if self._may_steer(token):
            return ""
        if not (self._tokens.watch and _is_same(token, self._tokens.watch)):
            return f"{'wrong token' if token else 'no token'}; open the address that haptigraph printed"
        is_safe = scope["type"] == "websocket" or scope["method"] in SAFE_METHODS
        if is_safe and WATCHED.fullmatch(scope["path"]):
            return ""
        return "this address only watches; open the one to steer that haptigraph printed"

    def _may_steer(self, token: str) -> bool:
        return not self._tokens.steer or _is_same(token, self._tokens.steer)


def _is_same(token: str, secret: str) -> bool:
    return hmac.compare_digest(token.encode(), secret.encode())


def _cookie(headers: Headers) -> str:
    morsel = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    return morsel.value if morsel else ""


async def _refuse(reason: str, scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":  # the browser does not pass the reason on to its page
        await receive()
        await send({"type": "websocket.close", "code": 1008, "reason": reason})
        return
    await PlainTextResponse(f"haptigraph: {reason}\n", status_code=403)(scope, receive, send)


def _with_headers(send: Send, host: str) -> Send:
    async def wrapped(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers["Content-Security-Policy"] = POLICY.format(host=host)
            headers["X-Content-Type-Options"] = "nosniff"
            headers["Referrer-Policy"] = "no-referrer"
            headers["Cross-Origin-Resource-Policy"] = "same-origin"
            headers.setdefault("Cache-Control", "no-cache")
        await send(message)

    return wrapped
