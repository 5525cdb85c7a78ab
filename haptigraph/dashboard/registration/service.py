"""Where registrations are made: reads sources, keeps what was found in them, writes files.

Knows no HTTP. Others than this machine may read and write in the working folder only.
"""

import asyncio
import pickle
import time
from itertools import count
from pathlib import Path
from typing import Any

from haptigraph.analysis.registering.draft import (
    Draft,
    Opened,
    draft_from,
    sound_picture,
    sound_registration,
)
from haptigraph.analysis.registering.registering import write_files
from haptigraph.assemble import SOURCES
from haptigraph.dashboard.jobs.process import Jobs
from haptigraph.dashboard.jobs.register import LOOK_S
from haptigraph.dashboard.server.site import Site
from haptigraph.errors import BadInput
from haptigraph.messages import Image
from haptigraph.registration.loading import load_camera_registration
from haptigraph.sources.naming import CAMERAS, split_source

__all__ = ["ExistsAlready", "RegistrationService"]

LIVE = (*CAMERAS, "teleop")  # what has no end, and cannot be opened twice
MOST_OPENED = 4
GLANCE_S = 0.1


class ExistsAlready(BadInput):
    """A file stands where another is to be written."""


class RegistrationService:
    """Keep the sources that were opened last, by number.

    Args:
        site: Says what runs now, and who may come.
    """

    def __init__(self, site: Site) -> None:
        self.progress = ""
        """What is being done, for people who wait."""
        self._site, self._jobs, self._turn = site, Jobs(Path()), asyncio.Lock()
        self._numbers = count(1)
        self._opened: dict[int, Opened] = {}

    async def open(self, source: str, *, mirrored: bool, diameter_mm: float) -> int:
        """Look at a source; takes seconds. Returns its number.

        Raises:
            BadInput: If it cannot be read. That nothing is found in it is no error.
        """
        source = source if self._site.is_local else self._permitted(source)
        async with self._turn:  # one at a time: it takes all of a processor
            self.progress = "opening"
            try:
                opened = await self._looked_at(source, mirrored, diameter_mm)
            finally:
                self.progress = ""
        number = next(self._numbers)
        self._opened[number] = opened
        while len(self._opened) > MOST_OPENED:
            del self._opened[min(self._opened)]
        return number

    def opened(self, number: int) -> Opened:
        """Return what was found.

        Raises:
            BadInput: If it is not kept any more.
        """
        if number not in self._opened:
            raise BadInput("this picture is not kept any more; open its source again")
        return self._opened[number]

    def place(self, source: str) -> str:
        """Return where a registration of a source is best saved."""
        path = Path(source)
        folder = path.parent if self._site.is_local and path.exists() else Path()
        return str(folder / "registration.toml")

    def load(self, number: int, path: str) -> Draft:
        """Return the draft that a registration file is, to correct it over an opened source.

        Raises:
            BadInput: If it cannot be read, or is for other images.
        """
        opened, file = self.opened(number), self._file(path)
        try:
            return draft_from(load_camera_registration(file), file.name, opened)
        except BadInput as error:
            raise BadInput(error.problem, file, error.place) from None

    def save(self, number: int, draft: Draft, path: str, *, picture: bool, overwrite: bool) -> list[str]:
        """Write a draft as a registration, and its picture beside it; return the paths.

        Raises:
            ExistsAlready: If a file exists and may not be overwritten.
            BadInput: If a run would refuse the draft, or it cannot be written; nothing is written then.
        """
        opened = self.opened(number)
        file = self._file(path)
        if file.suffix != ".toml":
            raise BadInput("the name of a registration ends in .toml", path or "''")
        contents = {file: sound_registration(opened, draft).text.encode()}
        if picture:
            contents[file.with_suffix(".png")] = sound_picture(opened, draft)
        for each in contents:
            _check_place(each, opened.source, overwrite=overwrite)
        try:
            write_files(tuple(contents), tuple(contents.values()))
        except OSError as error:
            raise BadInput(f"cannot be written ({error.strerror})", file) from None
        return [str(each) for each in contents]

    def _file(self, path: str) -> Path:
        return Path(path).expanduser() if self._site.is_local else Path(self._permitted(path))

    async def _looked_at(self, source: str, mirrored: bool, diameter_mm: float) -> Opened:
        seen = await self._seen(source)
        job = self._jobs.frames("register", source, self._site.asked, seen, mirrored, diameter_mm)
        async for content, data in job:
            if content["type"] == "opened":
                found: Opened = pickle.loads(data)
            elif content["type"] == "progress":
                self.progress = _words(content)
            else:
                raise BadInput(content["problem"])
        return found

    async def _seen(self, source: str) -> list[Image]:
        """Return what the loop sees for some seconds of a source that nobody else can look at meanwhile."""
        runs = source == self._site.source and self._site.on_registration is None
        if not runs or split_source(source, SOURCES)[0] not in LIVE:
            return []
        seen: dict[int, Image] = {}
        end_s = time.monotonic() + LOOK_S
        while time.monotonic() < end_s:
            capture = self._site.hub.newest_capture
            if capture is not None and capture.image is not None:
                seen[capture.index] = capture.image
            await asyncio.sleep(GLANCE_S)
        if not seen:
            raise BadInput("the loop gets no images from it just now", source)
        return list(seen.values())

    def _permitted(self, path: str) -> str:
        """Return a path that others than this machine may use."""
        folder = Path().resolve()
        named = path.partition(":")[0] in SOURCES
        if path == self._site.source or (not named and Path(path).resolve().is_relative_to(folder)):
            return path
        raise BadInput(
            "served to other machines, this page uses only files in the folder in which haptigraph runs, "
            "and the source it runs on",
            path,
        )


def _check_place(file: Path, source: str, *, overwrite: bool) -> None:
    if file.is_dir():
        raise BadInput("is a folder; the name of a file is needed", file)
    if not file.parent.is_dir():
        raise BadInput("its folder does not exist", file)
    if file.exists() and Path(source).exists() and file.samefile(source):
        raise BadInput("is the source itself; give the registration another name", file)
    if file.exists() and not overwrite:
        raise ExistsAlready("exists already", file)


def _words(progress: dict[str, Any]) -> str:
    return f"{progress['what']}: {progress['done']} images" if progress["done"] else str(progress["what"])
