"""The routes of the recordings page: the list, one step, and the answers of jobs.

A refusal is {"problem": one sentence}; in an answer that is a stream it may be the last message.
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
from haptigraph.dashboard.server.json_routes import json_errors, json_response
from haptigraph.dashboard.server.site import Site
from haptigraph.dashboard.server.stream import pack_message
from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.recording.reader import StepLocation

__all__ = ["routes"]

RUN_JOBS = ("timeline", "compare", "csv", "png")


def routes(site: Site) -> Sequence[BaseRoute]:
    """Return the routes of the recordings page."""
    page = _Recordings(RecordingFolder(site.recordings), Jobs(site.recordings))
    return [
        Route("/recordings/list", json_errors(page.list_runs)),
        Route("/recordings/step", json_errors(page.step)),
        Route("/recordings/outcomes", page.outcomes),
        Route("/recordings/find", page.find),
        Route("/recordings/{job}", page.job),
    ]


class _Recordings:
    def __init__(self, folder: RecordingFolder, jobs: Jobs) -> None:
        self._folder, self._jobs = folder, jobs

    async def list_runs(self, request: Request) -> Response:
        return json_response(await asyncio.to_thread(self._folder.list_runs))

    async def step(self, request: Request) -> Response:
        name, number = request.query_params.get("name", ""), request.query_params.get("number", "")
        if not number.isdecimal() or len(number) > 12:
            raise BadInput(f"{number!r} is not a valid step number; they count from 0", name)
        return Response(await asyncio.to_thread(self._folder.step, name, int(number)))

    async def outcomes(self, request: Request) -> Response:
        """Measure runs of the list, and cache the results."""
        return _stream(self._outcomes(request.query_params.getlist("name")))

    async def find(self, request: Request) -> Response:
        """Find recordings in the archive; the values of the form are bound, never part of a query's text."""
        return _stream(self._find(request.query_params.get("filter", "{}")))

    async def job(self, request: Request) -> Response:
        job = request.path_params["job"]
        if job not in RUN_JOBS:
            return json_response({"problem": f"unknown job {job!r}; valid: {', '.join(RUN_JOBS)}"}, 404)
        arguments = [request.query_params["procedure"]] if "procedure" in request.query_params else []
        return _stream(self._job(job, request.query_params.get("name", ""), arguments))

    async def _find(self, fields: str) -> AsyncIterator[bytes]:
        async for content, data in self._jobs.run("find", fields):
            yield pack_message(content, data)

    async def _outcomes(self, names: list[str]) -> AsyncIterator[bytes]:
        identities = dict[str, Identity]()
        for name in names:
            with suppress(HaptigraphError, OSError):  # gone since it was listed
                identities[name] = Identity.of(self._folder.path_of(name))
        async for content, data in self._jobs.run("outcomes", *identities):
            if content["type"] == "outcome":
                self._folder.outcomes[identities[content["name"]]] = content
            yield pack_message(content, data)

    async def _job(self, job: str, name: str, arguments: list[str]) -> AsyncIterator[bytes]:
        self._folder.path_of(name)
        if job == "compare" or (job == "png" and arguments):
            arguments = [self._procedure(*arguments)]
        elif arguments:
            raise BadInput(f"{job} does not take a procedure")
        async for content, data in self._jobs.run(job, name, *arguments):
            if content["type"] == "places":
                places = msgspec.json.decode(data, type=list[StepLocation])
                await asyncio.to_thread(self._folder.open_run, name, places)
            else:
                yield pack_message(content, data)

    def _procedure(self, name: str = "") -> str:
        """Check that a procedure file is in the folder; names without .toml ship with haptigraph."""
        if name.endswith(".toml"):
            self._folder.path_of(name)
        return name


def _stream(messages: AsyncIterator[bytes]) -> Response:
    async def body() -> AsyncIterator[bytes]:
        try:
            async for message in messages:
                yield message
        except (HaptigraphError, OSError) as error:
            yield pack_message({"type": "problem", "problem": str(error)})

    return StreamingResponse(body(), media_type="application/octet-stream")
