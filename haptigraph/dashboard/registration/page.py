"""The registration page's routes: open a source, check a dragged draft, load, save. JSON both ways."""

from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta, Struct
from msgspec.structs import asdict
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from haptigraph.analysis.registering.check import check_draft
from haptigraph.analysis.registering.draft import Draft
from haptigraph.dashboard.registration.service import FileExists, RegistrationService, SearchCancelled
from haptigraph.dashboard.server.json_routes import get_route, json_errors, json_response, read_json
from haptigraph.dashboard.server.site import Site
from haptigraph.recording.codec import encode_png

__all__ = ["Cancel", "Check", "Load", "Open", "Save", "routes"]

Text = Annotated[str, Meta(min_length=1, max_length=4096, pattern=r"^[^\x00]*$")]


class Cancel(Struct, frozen=True, forbid_unknown_fields=True):
    """Body: cancel the search in a source."""

    source: Text
    mirrored: bool
    diameter_mm: Annotated[float, Meta(gt=0, le=1000)]


class Open(Cancel, frozen=True, forbid_unknown_fields=True):
    """Body: open a source."""

    resume: bool = False
    """Whether to begin no search, but return the result of one that runs or has ended."""


class Check(Struct, frozen=True, forbid_unknown_fields=True):
    """Body: compare a draft with the images."""

    number: int
    """Of the opened source."""
    draft: Draft


class Load(Struct, frozen=True, forbid_unknown_fields=True):
    """Body: read a draft from a file."""

    number: int
    path: Text


class Save(Struct, frozen=True, forbid_unknown_fields=True):
    """Body: write a draft to a file."""

    number: int
    draft: Draft
    path: Text
    picture: bool
    overwrite: bool


def routes(site: Site) -> Sequence[BaseRoute]:
    """Return the routes of the registration page."""
    service, starts_loop = RegistrationService(site), site.on_registration is not None

    async def open_source(request: Request) -> Response:
        body = await read_json(request, Open)
        try:
            number = await service.open(**asdict(body))
        except SearchCancelled:
            return json_response({"cancelled": True})
        opened = service.opened(number)
        height_px, width_px = opened.reference_image.shape[:2]
        return json_response(
            {
                "number": number,
                "width_px": width_px,
                "height_px": height_px,
                "draft": opened.draft,
                "is_found": opened.anatomy is not None,
                "note": opened.note,
                "path": service.default_path(body.source),
            }
        )

    async def cancel(request: Request) -> Response:
        service.cancel(**asdict(await read_json(request, Cancel)))
        return json_response({})

    async def picture(request: Request) -> Response:
        reference_image = service.opened(request.path_params["number"]).reference_image
        return Response(await run_in_threadpool(encode_png, reference_image), media_type="image/png")

    async def check(request: Request) -> Response:
        body = await read_json(request, Check)
        return json_response(await run_in_threadpool(check_draft, service.opened(body.number), body.draft))

    async def load(request: Request) -> Response:
        body = await read_json(request, Load)
        return json_response({"draft": await run_in_threadpool(service.load, body.number, body.path)})

    async def save(request: Request) -> Response:
        body = await read_json(request, Save)
        flags = {"picture": body.picture, "overwrite": body.overwrite}
        try:
            paths = await run_in_threadpool(service.save, body.number, body.draft, body.path, **flags)
        except FileExists as error:
            return json_response({"paths": [], "exists": str(error)})  # a question, no failure
        if site.on_registration is not None:
            site.on_registration(paths[0])
        return json_response({"paths": paths, "exists": ""})

    return [
        get_route("/registration/start", lambda: {"source": site.source, "starts_loop": starts_loop}),
        get_route("/registration/progress", lambda: {"progress": service.progress}),
        Route("/registration/picture/{number:int}", json_errors(picture)),
        Route("/registration/open", json_errors(open_source), methods=["POST"]),
        Route("/registration/cancel", json_errors(cancel), methods=["POST"]),
        Route("/registration/check", json_errors(check), methods=["POST"]),
        Route("/registration/load", json_errors(load), methods=["POST"]),
        Route("/registration/save", json_errors(save), methods=["POST"]),
    ]
