"""Who may come in: checks host, origin and token of every request; and the headers that keep pages to us.

Knows no page. A page from elsewhere, opened in the same browser, can neither read nor steer.
"""

import hmac
from http.cookies import SimpleCookie
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["LOOPBACK", "AccessControl"]

LOOPBACK = ("127.0.0.1", "localhost", "::1")
COOKIE = "haptigraph_token"
SAFE_METHODS = ("GET", "HEAD")
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'self' ws://{host}; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)


class AccessControl:
    """Let through to an app only who is meant to get in.

    Args:
        app: What is behind.
        host: The address the server listens on; others than loopback need a token.
        token: What visitors must know; empty: nothing.
    """

    def __init__(self, app: ASGIApp, *, host: str, token: str) -> None:
        self._app, self._host, self._token = app, host, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request, or hand it on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        refusal = self._refusal(scope, headers, given)
        if refusal:
            await _refuse(refusal, scope, receive, send)
        elif given and self._token and scope["type"] == "http":
            # The token moves from the address, which is shown and shared, into a cookie.
            answer = RedirectResponse(scope["path"], status_code=303)
            answer.set_cookie(COOKIE, self._token, httponly=True, samesite="strict")
            await answer(scope, receive, send)
        else:
            await self._app(scope, receive, _with_headers(send, headers.get("host", "")))

    def _refusal(self, scope: Scope, headers: Headers, given: str) -> str:
        """Say why somebody may not come in; empty if they may."""
        host = headers.get("host", "")
        name = host.rpartition(":")[0].strip("[]") if ":" in host else host
        if self._host in LOOPBACK and name not in LOOPBACK:
            return f"this page is for {self._host} only, not for {name or 'a host without name'}"
        origin = headers.get("origin")
        is_safe = scope["type"] == "http" and scope["method"] in SAFE_METHODS
        if origin is not None and origin != f"http://{host}" and not is_safe:
            return f"pages from {origin} may not talk to this one"
        if origin is None and not is_safe:
            return "no origin; only this page's own scripts may do that"
        if self._token and not hmac.compare_digest(
            (given or _cookie(headers)).encode(), self._token.encode()
        ):
            what = "wrong token" if given or _cookie(headers) else "no token"
            return f"{what}; open the address that haptigraph printed"
        return ""


def _cookie(headers: Headers) -> str:
    morsel = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    return morsel.value if morsel else ""


async def _refuse(reason: str, scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":  # the browser tells its page no more than that it was refused
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
