"""The live page's route: one WebSocket per page, over which it watches and steers."""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import count
from typing import Any

from starlette.routing import BaseRoute, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from haptigraph.dashboard.server.access import is_local, may_steer
from haptigraph.dashboard.server.controls import Controls
from haptigraph.dashboard.server.hub import Hub
from haptigraph.dashboard.server.protocol import (
    Ack,
    ClientMessage,
    EnterPhase,
    Motion,
    Outputs,
    Ping,
    Played,
    ReleaseControls,
    SwitchRobot,
    TakeControls,
    Tune,
    Watch,
    parse_client_message,
    text_message,
)
from haptigraph.dashboard.server.site import Site
from haptigraph.dashboard.server.viewer import Viewer

__all__ = ["routes"]

MAX_VIEWERS = 16
STEERING = (TakeControls, SwitchRobot, Tune, EnterPhase)


def routes(
    site: Site, path: str = "/live", name: str = "page", is_blind: Callable[[], bool] = lambda: False
) -> Sequence[BaseRoute]:
    """Return the routes of the live page, or of another that shows a run.

    Args:
        site: Context of the routes.
        path: Of the WebSocket.
        name: Of its pages, with a number, in the controls and the health.
        is_blind: Whether a page that opens it is blinded.
    """
    hub, controls, numbers = site.hub, site.controls, count(1)

    async def endpoint(websocket: WebSocket) -> None:
        await websocket.accept()
        if len(hub.viewers) >= MAX_VIEWERS:
            await websocket.close(1013, f"{MAX_VIEWERS} pages watch already; close one")
            return
        scope = websocket.scope
        viewer = Viewer(
            f"{name} {next(numbers)}",
            may_steer=may_steer(scope),
            is_blind=is_blind(),
            is_local=is_local(scope),
        )
        refusal = controls.robot_refusal(viewer)
        welcome = {"name": viewer.name, "may_steer": viewer.may_steer and not refusal, "refusal": refusal}
        viewer.put_text(text_message("welcome", **welcome))
        hub.join(viewer)
        sender = asyncio.create_task(_send(websocket, viewer))
        try:
            await _receive(websocket, viewer, hub, controls)
        finally:
            controls.release(viewer)
            hub.leave(viewer)
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)

    return [WebSocketRoute(path, endpoint)]


async def _send(websocket: WebSocket, viewer: Viewer) -> None:
    while True:
        message = await viewer.next()
        if isinstance(message, bytes):
            await websocket.send_bytes(message)
        else:
            await websocket.send_text(message)


async def _receive(websocket: WebSocket, viewer: Viewer, hub: Hub, controls: Controls) -> None:
    while (received := await websocket.receive())["type"] == "websocket.receive":
        try:
            message = parse_client_message(_text(received))
        except ValueError as error:
            # Sent from here, so that a page that sends invalid messages waits until it has read the answer.
            with suppress(WebSocketDisconnect, RuntimeError):  # disconnected; starlette raises either
                await websocket.send_text(text_message("error", message=f"invalid message: {error}"))
        else:
            _handle(message, viewer, hub, controls)


def _text(received: Any) -> str:
    text = received.get("text")
    if not isinstance(text, str):
        raise ValueError("binary data; a page sends JSON text")
    return text


def _handle(message: ClientMessage, viewer: Viewer, hub: Hub, controls: Controls) -> None:
    if isinstance(message, Ack):
        viewer.acknowledge(message.number)
    elif isinstance(message, Watch):
        viewer.wants_images = message.images
    elif isinstance(message, Ping):
        viewer.put_text(text_message("pong", time_ms=message.time_ms, now_ms=hub.now_ms()))
    elif isinstance(message, Outputs):
        hub.set_outputs(viewer, message.names)
    elif isinstance(message, Played):
        hub.log_played(message.output, message.start_ms, message.end_ms)
    elif isinstance(message, STEERING) and not viewer.may_steer:
        viewer.put_text(text_message("error", message="this page watches only; it cannot steer"))
    else:
        _steer(message, viewer, controls)


def _steer(message: ClientMessage, viewer: Viewer, controls: Controls) -> None:
    if isinstance(message, Motion):
        controls.move(viewer, message.hand, message.sent_ms)
    elif isinstance(message, SwitchRobot):
        controls.switch(viewer, on=message.on)
    elif isinstance(message, TakeControls):
        controls.take(viewer)
    elif isinstance(message, Tune):
        controls.tune(viewer, message.changes())
    elif isinstance(message, ReleaseControls):
        controls.release(viewer)
    elif isinstance(message, EnterPhase):
        controls.enter_phase(viewer, message.phase)
