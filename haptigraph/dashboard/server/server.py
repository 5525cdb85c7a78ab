"""The web server beside the loop, in a thread of its own: static files, routes, access control.

To add a page: put NAME.html and its modules into a folder of `static/`, write a Python module with a function
that takes the `Site` and returns routes, and add both to `PAGES`. Navigation and addresses follow from there.
"""

import asyncio
import contextlib
import html
import mimetypes
import socket
import threading
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from importlib import resources
from typing import Any, NamedTuple

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Route

from haptigraph.dashboard.server.access import AccessControl, Tokens, may_steer
from haptigraph.dashboard.server.connections import BoundedConnection, BoundedLog
from haptigraph.dashboard.server.site import Site
from haptigraph.errors import BadInput
from haptigraph.importing import load

__all__ = ["LIVE", "PAGES", "REGISTRATION", "STUDY_PAGES", "Page", "Server", "listen", "make_app"]

STATIC = resources.files("haptigraph.dashboard").joinpath("static")
MAX_MESSAGE_BYTES = 65_536
STOP_S = 3.0
BACKLOG = 100  # connections that wait until the server accepts them


class Page(NamedTuple):
    """One page of the site."""

    title: str
    """In the navigation."""
    path: str
    file: str
    """HTML in `static/`; its `<nav></nav>` is filled in."""
    routes: str
    """"module:function"; the function takes the `Site` and returns routes."""


LIVE = Page("Live", "/", "live/live.html", "haptigraph.dashboard.live.page:routes")
REGISTRATION = Page(
    "Registration",
    "/registration",
    "registration/registration.html",
    "haptigraph.dashboard.registration.page:routes",
)
RECORDINGS = Page(
    "Recordings", "/recordings", "recordings/recordings.html", "haptigraph.dashboard.recordings.page:routes"
)
PAGES = (LIVE, REGISTRATION, RECORDINGS)
STUDY_PAGES = (
    Page("Study", "/", "study/study.html", "haptigraph.dashboard.study.experimenter_page:routes"),
    Page(
        "Participant",
        "/participant",
        "study/participant.html",
        "haptigraph.dashboard.study.participant_page:routes",
    ),
)


def make_app(
    site: Site,
    health: Callable[[], dict[str, Any]],
    *,
    host: str,
    tokens: Tokens,
    pages: Sequence[Page] = PAGES,
    pump: Callable[[], Coroutine[Any, Any, None]] | None = None,
) -> AccessControl:
    """Return the ASGI app.

    Args:
        site: Context of the routes.
        health: Returns the fields of the health message.
        host: The address that the server listens on.
        tokens: What visitors must present.
        pages: The pages; "/" redirects to the first.
        pump: Runs beside the server until it stops.
    """

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        tasks = [asyncio.create_task(site.hub.pump(health))]
        tasks += [asyncio.create_task(pump())] if pump else []
        yield
        for task in tasks:
            task.cancel()

    routes: list[BaseRoute] = [Route(page.path, _html(page, pages)) for page in pages]
    routes += [Route("/", _redirect(pages[0].path))] if pages[0].path != "/" else []
    routes += [Route("/static/{folder}/{name}", _static_file)]
    routes += [route for page in pages for route in _page_routes(page, site)]
    app = Starlette(routes=routes, lifespan=lifespan, exception_handlers={404: _not_found})
    entrances = frozenset({"/", *(page.path for page in pages)})
    return AccessControl(app, host=host, tokens=tokens, entrances=entrances)


def _page_routes(page: Page, site: Site) -> Sequence[BaseRoute]:
    routes: Sequence[BaseRoute] = load(page.routes)(site)
    return routes


def _redirect(path: str) -> Callable[[Request], Any]:
    async def endpoint(request: Request) -> Response:
        return RedirectResponse(path, status_code=303)

    return endpoint


def _html(page: Page, pages: Sequence[Page]) -> Callable[[Request], Any]:
    text = STATIC.joinpath(page.file).read_text(encoding="utf-8")
    steering, watching = (
        text.replace("<nav></nav>", f'<nav aria-label="Pages">{_links(page, linked)}</nav>')
        for linked in (pages, (page,))
    )

    async def endpoint(request: Request) -> Response:
        return HTMLResponse(steering if may_steer(request.scope) else watching)

    return endpoint


def _links(page: Page, pages: Sequence[Page]) -> str:
    return "".join(
        f'<a href="{other.path}"{" aria-current=page" * (other is page)}>{html.escape(other.title)}</a>'
        for other in pages
    )


async def _not_found(request: Request, error: Exception) -> Response:
    return PlainTextResponse(f"haptigraph: no such page: {request.url.path}\n", status_code=404)


async def _static_file(request: Request) -> Response:
    """Serve a file of `static/`; only names that are listed there, so that no path leads out of it."""
    folder, name = request.path_params["folder"], request.path_params["name"]
    for directory in STATIC.iterdir():
        for file in directory.iterdir() if directory.name == folder else ():
            if file.name == name:
                kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
                kind = "text/javascript" if name.endswith(".js") else kind  # some systems guess text/plain
                return Response(file.read_bytes(), media_type=kind)
    return PlainTextResponse(f"haptigraph: no such file: {folder}/{name}\n", status_code=404)


def listen(host: str, port: int) -> socket.socket:
    """Return a listening socket.

    Args:
        host: Address to listen on.
        port: Port; 0: any free one.

    Raises:
        BadInput: If the address or port cannot be used.
    """
    try:
        (family, kind, protocol, _, address), *_ = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        listener = socket.socket(family, kind, protocol)
    except (OSError, UnicodeError):
        raise BadInput(
            f"--host {host!r} is not an address of this machine; use 127.0.0.1 for this machine only"
        ) from None
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(BACKLOG)
    except OSError as error:
        listener.close()
        hint = "; omit --port to use a free one" if port else ""
        raise BadInput(f"cannot listen on {host}, port {port} ({error.strerror}){hint}") from None
    return listener


class Server:
    """Run an app in a thread; a context manager.

    Args:
        app: The ASGI app.
        listener: Its socket; closed on exit.
    """

    def __init__(self, app: AccessControl, listener: socket.socket) -> None:
        self._listener = listener
        config = uvicorn.Config(
            app,
            ws="websockets-sansio",
            http=BoundedConnection,
            backlog=BACKLOG,
            loop="asyncio",
            lifespan="on",
            log_config=None,
            access_log=False,
            proxy_headers=False,  # which would replace the address of the sender
            server_header=False,
            ws_max_size=MAX_MESSAGE_BYTES,
            ws_ping_interval=5.0,
            ws_ping_timeout=5.0,
            ws_per_message_deflate=False,
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._run, name="haptigraph-server", daemon=True)

    def __enter__(self) -> "Server":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.should_exit = True
        self._thread.join(STOP_S)
        self._listener.close()

    def _run(self) -> None:
        with BoundedLog():
            self._server.run(sockets=[self._listener])
