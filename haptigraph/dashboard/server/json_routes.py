"""Routes that read and answer JSON; a request that cannot be served gets {"problem": one sentence}."""

from collections.abc import Awaitable, Callable
from typing import Any, TypeAlias, TypeVar

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from haptigraph.errors import HaptigraphError, StoreFailed

__all__ = ["get_route", "json_errors", "json_response", "post_route", "read_json"]

T = TypeVar("T")
Endpoint: TypeAlias = Callable[[Request], Awaitable[Response]]
MAX_BYTES = 262_144


async def read_json(request: Request, kind: type[T]) -> T:
    """Parse the body of a request.

    Raises:
        ValueError: If it is too large or not a valid `kind`.
    """
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > MAX_BYTES:
            raise ValueError(f"more than {MAX_BYTES} bytes")
    try:
        return msgspec.json.decode(body, type=kind)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def json_response(content: Any, status: int = 200) -> Response:
    """Return a response that must not be cached."""
    return Response(
        msgspec.json.encode(content),
        status_code=status,
        media_type="application/json",
        headers={"Cache-Control": "no-store"},
    )


def json_errors(endpoint: Endpoint) -> Endpoint:
    """Decorate an endpoint to answer errors with one sentence."""

    async def wrapped(request: Request) -> Response:
        try:
            return await endpoint(request)
        except ClientDisconnect:
            return Response(status_code=400)  # which nobody receives
        except StoreFailed as error:
            return json_response({"problem": str(error)}, 503)
        except (HaptigraphError, OSError) as error:
            return json_response({"problem": str(error)}, 422)
        except (ValueError, ArithmeticError) as error:
            return json_response({"problem": f"invalid request: {error}"}, 400)

    return wrapped


def get_route(path: str, read: Callable[[], Any]) -> Route:
    """Return a GET route that answers what `read` returns; it is called in a worker thread."""

    async def endpoint(request: Request) -> Response:
        return json_response(await run_in_threadpool(read))

    return Route(path, json_errors(endpoint))


def post_route(path: str, kind: type[T], act: Callable[[T], object], read: Callable[[], Any]) -> Route:
    """Return a POST route that acts on its body and then answers what `read` returns.

    Args:
        path: Of the route.
        kind: Of the body.
        act: Called with the body, in a worker thread.
        read: Called afterwards, in a worker thread.
    """

    async def endpoint(request: Request) -> Response:
        await run_in_threadpool(act, await read_json(request, kind))
        return json_response(await run_in_threadpool(read))

    return Route(path, json_errors(endpoint), methods=["POST"])
