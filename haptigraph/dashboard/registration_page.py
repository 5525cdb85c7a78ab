"""The registration page's own routes: open a source, check what somebody dragged, save it. JSON both ways.

Whatever cannot be used is answered with {"problem": one sentence}.
"""

import asyncio
import threading
from collections.abc import Awaitable, Callable, Sequence
from concurrent.futures import Future
from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np
from msgspec import Meta, Struct
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from haptigraph.analysis.registration_check import check_draft
from haptigraph.analysis.registration_draft import Draft
from haptigraph.dashboard.registration_desk import Desk, ExistsAlready
from haptigraph.dashboard.site import Site
from haptigraph.errors import HaptigraphError
from haptigraph.recording.codec import encode_png

__all__ = ["Check", "Open", "Save", "routes"]

T = TypeVar("T")
MOST_BYTES = 262_144

Text = Annotated[str, Meta(min_length=1, max_length=4096, pattern=r"^[^\x00]*$")]


class Open(Struct, frozen=True, forbid_unknown_fields=True):
    """Look at a source."""

    source: Text
    mirrored: bool
    diameter_mm: Annotated[float, Meta(gt=0, le=1000)]


class Check(Struct, frozen=True, forbid_unknown_fields=True):
    """How well does this fit?"""

    number: int
    """Of the opened source."""
    draft: Draft


class Save(Struct, frozen=True, forbid_unknown_fields=True):
    """Write this."""

    number: int
    draft: Draft
    path: Text
    overwrite: bool


def routes(site: Site) -> Sequence[BaseRoute]:
    """Return the routes of the registration page."""
    desk, turn = Desk(site), asyncio.Lock()

    async def start(request: Request) -> Response:
        return _json({"source": site.source, "starts": site.on_registration is not None})

    async def progress(request: Request) -> Response:
        return _json({"progress": desk.progress})

    async def open_source(request: Request) -> Response:
        wish = await _asked(request, Open)
        async with turn:  # one at a time: it takes all of a processor, for seconds
            number = await _aside(
                lambda: desk.open(wish.source, mirrored=wish.mirrored, diameter_mm=wish.diameter_mm)
            )
        opened = desk.opened(number)
        height_px, width_px = opened.still.shape[:2]
        return _json(
            {
                "number": number,
                "width_px": width_px,
                "height_px": height_px,
                "draft": opened.draft,
                "is_found": opened.anatomy is not None,
                "note": opened.note,
                "path": desk.place(wish.source),
            }
        )

    async def picture(request: Request) -> Response:
        still = desk.opened(request.path_params["number"]).still
        return Response(await run_in_threadpool(encode_png, still), media_type="image/png")

    async def check(request: Request) -> Response:
        wish = await _asked(request, Check)
        return _json(await run_in_threadpool(check_draft, desk.opened(wish.number), wish.draft))

    async def save(request: Request) -> Response:
        wish = await _asked(request, Save)
        saved = desk.save(wish.number, wish.draft, wish.path, overwrite=wish.overwrite)
        if site.on_registration is not None:
            site.on_registration(saved)
        return _json({"path": saved})

    return [
        Route("/registration/start", _told(start)),
        Route("/registration/progress", _told(progress)),
        Route("/registration/picture/{number:int}", _told(picture)),
        Route("/registration/open", _told(open_source), methods=["POST"]),
        Route("/registration/check", _told(check), methods=["POST"]),
        Route("/registration/save", _told(save), methods=["POST"]),
    ]


def _json(content: Any, status: int = 200) -> Response:
    headers = {"Cache-Control": "no-store"}
    return Response(
        msgspec.json.encode(content, enc_hook=_plain),
        status_code=status,
        media_type="application/json",
        headers=headers,
    )


def _plain(value: Any) -> Any:
    """Return what JSON knows for one of NumPy's numbers."""
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError


def _told(answer: Callable[[Request], Awaitable[Response]]) -> Callable[[Request], Awaitable[Response]]:
    """Wrap a route so that what cannot be used is told in one sentence."""

    async def wrapped(request: Request) -> Response:
        try:
            return await answer(request)
        except ExistsAlready as error:
            return _json({"problem": str(error), "exists": True}, 409)
        except HaptigraphError as error:
            return _json({"problem": str(error)}, 422)
        except ValueError as error:
            return _json({"problem": f"not understood: {error}"}, 400)

    return wrapped


async def _asked(request: Request, kind: type[T]) -> T:
    """Read what a page asks for.

    Raises:
        ValueError: If it is no such thing.
    """
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > MOST_BYTES:
            raise ValueError(f"more than {MOST_BYTES} bytes")
    try:
        return msgspec.json.decode(body, type=kind)
    except RecursionError:
        raise ValueError("nested too deeply") from None


async def _aside(work: Callable[[], T]) -> T:
    """Do long work in a thread that keeps nobody waiting who wants to end the program."""
    done: Future[T] = Future()
    done.set_running_or_notify_cancel()

    def run() -> None:
        try:
            done.set_result(work())
        except Exception as error:
            done.set_exception(error)

    threading.Thread(target=run, name="haptigraph-registering", daemon=True).start()
    return await asyncio.wrap_future(done)
