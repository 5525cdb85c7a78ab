"""The registration page's own routes: open a source, check what was dragged, load, save. JSON both ways."""

from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta, Struct
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from haptigraph.analysis.registering.check import check_draft
from haptigraph.analysis.registering.draft import Draft
from haptigraph.dashboard.registration.service import ExistsAlready, RegistrationService
from haptigraph.dashboard.server.answers import as_json, asked, telling
from haptigraph.dashboard.server.site import Site
from haptigraph.recording.codec import encode_png

__all__ = ["Check", "Load", "Open", "Save", "routes"]

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


class Load(Struct, frozen=True, forbid_unknown_fields=True):
    """Read a file instead of what was found."""

    number: int
    path: Text


class Save(Struct, frozen=True, forbid_unknown_fields=True):
    """Write this."""

    number: int
    draft: Draft
    path: Text
    picture: bool
    overwrite: bool


def routes(site: Site) -> Sequence[BaseRoute]:
    """Return the routes of the registration page."""
    service = RegistrationService(site)

    async def start(request: Request) -> Response:
        return as_json({"source": site.source, "starts": site.on_registration is not None})

    async def progress(request: Request) -> Response:
        return as_json({"progress": service.progress})

    async def open_source(request: Request) -> Response:
        wish = await asked(request, Open)
        number = await service.open(wish.source, mirrored=wish.mirrored, diameter_mm=wish.diameter_mm)
        opened = service.opened(number)
        height_px, width_px = opened.still.shape[:2]
        return as_json(
            {
                "number": number,
                "width_px": width_px,
                "height_px": height_px,
                "draft": opened.draft,
                "is_found": opened.anatomy is not None,
                "note": opened.note,
                "path": service.place(wish.source),
            }
        )

    async def picture(request: Request) -> Response:
        still = service.opened(request.path_params["number"]).still
        return Response(await run_in_threadpool(encode_png, still), media_type="image/png")

    async def check(request: Request) -> Response:
        wish = await asked(request, Check)
        return as_json(await run_in_threadpool(check_draft, service.opened(wish.number), wish.draft))

    async def load(request: Request) -> Response:
        wish = await asked(request, Load)
        return as_json({"draft": await run_in_threadpool(service.load, wish.number, wish.path)})

    async def save(request: Request) -> Response:
        wish = await asked(request, Save)
        flags = {"picture": wish.picture, "overwrite": wish.overwrite}
        try:
            paths = await run_in_threadpool(service.save, wish.number, wish.draft, wish.path, **flags)
        except ExistsAlready as error:
            return as_json({"problem": str(error), "exists": True}, 409)
        if site.on_registration is not None:
            site.on_registration(paths[0])
        return as_json({"paths": paths})

    return [
        Route("/registration/start", telling(start)),
        Route("/registration/progress", telling(progress)),
        Route("/registration/picture/{number:int}", telling(picture)),
        Route("/registration/open", telling(open_source), methods=["POST"]),
        Route("/registration/check", telling(check), methods=["POST"]),
        Route("/registration/load", telling(load), methods=["POST"]),
        Route("/registration/save", telling(save), methods=["POST"]),
    ]
