"""The routes of the page of recordings: the list, one step, and what jobs answer.

docs/dashboard.md has them all. What is refused is one sentence: {"problem": ...}, which may be the last frame
of an answer that comes in frames.
"""

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress

import msgspec
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import BaseRoute, Route

from haptigraph.dashboard.jobs.process import Jobs
from haptigraph.dashboard.recordings.folder import Identity, RecordingFolder
from haptigraph.dashboard.server.answers import as_json, telling
from haptigraph.dashboard.server.frames import framed
from haptigraph.dashboard.server.site import Site
from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.recording.reader import Place

__all__ = ["routes"]

ALONE = ("timeline", "compare", "csv", "png")


def routes(site: Site) -> Sequence[BaseRoute]:
    """Return the routes of the page of recordings."""
    page = _Recordings(RecordingFolder(site.recordings), Jobs(site.recordings))
    return [
        Route("/recordings/list", telling(page.listed)),
        Route("/recordings/step", telling(page.step)),
        Route("/recordings/outcomes", page.outcomes),
        Route("/recordings/{job}", page.job),
    ]


class _Recordings:
    def __init__(self, folder: RecordingFolder, jobs: Jobs) -> None:
        self._folder, self._jobs = folder, jobs

    async def listed(self, request: Request) -> Response:
        return as_json(await asyncio.to_thread(self._folder.listed))

    async def step(self, request: Request) -> Response:
        name, number = request.query_params.get("name", ""), request.query_params.get("number", "")
        if not number.isdecimal() or len(number) > 12:
            raise BadInput(f"{number!r} is no number of a step", name)
        return Response(await asyncio.to_thread(self._folder.step, name, int(number)))

    async def outcomes(self, request: Request) -> Response:
        """Measure runs for the list, and remember."""
        return _in_frames(self._outcomes(request.query_params.getlist("name")))

    async def job(self, request: Request) -> Response:
        job = request.path_params["job"]
        if job not in ALONE:
            return as_json({"problem": f"there is no {job!r}; there are {', '.join(ALONE)}"}, 404)
        arguments = [request.query_params["procedure"]] if "procedure" in request.query_params else []
        return _in_frames(self._job(job, request.query_params.get("name", ""), arguments))

    async def _outcomes(self, names: list[str]) -> AsyncIterator[bytes]:
        known = dict[str, Identity]()
        for name in names:
            with suppress(HaptigraphError, OSError):  # gone meanwhile: nothing to tell
                known[name] = Identity.of(self._folder.path_of(name))
        async for content, data in self._jobs.frames("outcomes", *known):
            if content["type"] == "outcome":
                self._folder.outcomes[known[content["name"]]] = content
            yield framed(content, data)

    async def _job(self, job: str, name: str, arguments: list[str]) -> AsyncIterator[bytes]:
        self._folder.path_of(name)
        if job == "compare":
            arguments = [self._procedure(*arguments)]
        elif arguments:
            raise BadInput(f"{job} takes no procedure")
        async for content, data in self._jobs.frames(job, name, *arguments):
            if content["type"] == "places":
                places = msgspec.json.decode(data, type=list[Place])
                await asyncio.to_thread(self._folder.keep, name, places)
            else:
                yield framed(content, data)

    def _procedure(self, name: str = "") -> str:
        """Check that a procedure ships with haptigraph or is in the folder."""
        if name.endswith(".toml"):
            self._folder.path_of(name)
        return name


def _in_frames(frames: AsyncIterator[bytes]) -> Response:
    async def told() -> AsyncIterator[bytes]:
        try:
            async for frame in frames:
                yield frame
        except (HaptigraphError, OSError) as error:
            yield framed({"type": "problem", "problem": str(error)})

    return StreamingResponse(told(), media_type="application/octet-stream")
