"""How routes read and answer JSON, and say that something cannot be used: {"problem": one sentence}."""

from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from haptigraph.errors import HaptigraphError, StoreFailed

__all__ = ["acting", "as_json", "asked", "asking", "telling"]

T = TypeVar("T")
MOST_BYTES = 262_144


async def asked(request: Request, kind: type[T]) -> T:
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


def as_json(content: Any, status: int = 200) -> Response:
    """Return an answer that nobody keeps."""
    return Response(
        msgspec.json.encode(content),
        status_code=status,
        media_type="application/json",
        headers={"Cache-Control": "no-store"},
    )


def telling(answer: Callable[[Request], Awaitable[Response]]) -> Callable[[Request], Awaitable[Response]]:
    """Wrap a route so that what cannot be used is told in one sentence."""

    async def wrapped(request: Request) -> Response:
        try:
            return await answer(request)
        except StoreFailed as error:
            return as_json({"problem": str(error)}, 503)
        except (HaptigraphError, OSError) as error:
            return as_json({"problem": str(error)}, 422)
        except (ValueError, ArithmeticError) as error:
            return as_json({"problem": f"not understood: {error}"}, 400)

    return wrapped


def asking(path: str, now: Callable[[], Any]) -> Route:
    """Return a route that says how things are; found out in a worker thread."""

    async def answer(request: Request) -> Response:
        return as_json(await run_in_threadpool(now))

    return Route(path, telling(answer))


def acting(path: str, kind: type[T], act: Callable[[T], object], now: Callable[[], Any]) -> Route:
    """Return a route that does what is asked for, in a worker thread, and says how things are then.

    Args:
        path: Of the route.
        kind: What is asked for.
        act: Does it.
        now: Says how things are.
    """

    async def answer(request: Request) -> Response:
        await run_in_threadpool(act, await asked(request, kind))
        return as_json(await run_in_threadpool(now))

    return Route(path, telling(answer), methods=["POST"])
