"""The service behind the registration page: opens sources, holds the results, writes registration files.

Clients of other machines may read and write in the working folder only.
"""

import asyncio
import pickle
import time
from contextlib import aclosing
from itertools import count
from pathlib import Path
from typing import Any, TypeAlias

from haptigraph.analysis.registering.draft import (
    Draft,
    OpenedSource,
    checked_registration,
    draft_from,
    draft_picture,
)
from haptigraph.assemble import SOURCES
from haptigraph.dashboard.jobs.process import Jobs
from haptigraph.dashboard.jobs.register import OBSERVE_S
from haptigraph.dashboard.server.site import Site
from haptigraph.errors import BadInput
from haptigraph.files import write_files
from haptigraph.messages import Image
from haptigraph.registration.loading import load_camera_registration
from haptigraph.sources.naming import CAMERAS, split_source

__all__ = ["FileExists", "RegistrationService", "SearchCancelled"]

LIVE = (*CAMERAS, "teleop")  # sources without an end, which cannot be opened twice
MAX_OPENED = 4
POLL_S = 0.1

Search: TypeAlias = tuple[str, bool, float]
"""Source, whether it is mirrored, diameter in mm."""


class SearchCancelled(BadInput):
    """The search for the eye was cancelled."""


class FileExists(BadInput):
    """A file exists and must not be overwritten."""


class RegistrationService:
    """Hold the sources that were opened last, by number.

    Args:
        site: Context: what runs, and whether only this machine has access.
    """

    def __init__(self, site: Site) -> None:
        self.progress = ""
        """Of the job that runs, for people who wait."""
        self._site, self._jobs, self._lock = site, Jobs(Path()), asyncio.Lock()
        self._numbers = count(1)
        self._opened: dict[int, OpenedSource] = {}
        self._searches: dict[Search, asyncio.Task[int]] = {}

    async def open(self, source: str, *, mirrored: bool, diameter_mm: float, resume: bool = False) -> int:
        """Read a source and find the eye in it, within seconds; return the source's number.

        A search that runs already is joined. It goes on if the caller leaves.

        Args:
            source: The source to read.
            mirrored: Whether the camera looks through a mirror.
            diameter_mm: Inner diameter of the globe.
            resume: Whether to begin no search, but return the result of one that runs or has ended.

        Raises:
            SearchCancelled: If `cancel` was called, or there is nothing to resume.
            BadInput: If it cannot be read. It is no error that no eye is found.
        """
        search = (source if self._site.is_local else self._permitted(source), mirrored, diameter_mm)
        task = self._searches.get(search)
        if task is None or (task.done() and not (resume and self._holds(task))):
            if resume:
                raise SearchCancelled("there is no such search")
            self._searches[search] = task = asyncio.create_task(self._search(*search))
        try:
            return await asyncio.shield(task)
        except asyncio.CancelledError:
            if task.cancelled():
                raise SearchCancelled("the search was cancelled") from None
            raise

    def cancel(self, source: str, *, mirrored: bool, diameter_mm: float) -> None:
        """Cancel a search that `open` began, if it still runs."""
        if task := self._searches.get((source, mirrored, diameter_mm)):
            task.cancel()

    def _holds(self, task: asyncio.Task[int]) -> bool:
        return not task.cancelled() and task.exception() is None and task.result() in self._opened

    async def _search(self, source: str, mirrored: bool, diameter_mm: float) -> int:
        async with self._lock:  # one at a time: each job uses a whole core
            self.progress = "opening"
            try:
                opened = await self._find_eye(source, mirrored, diameter_mm)
            finally:
                self.progress = ""
        number = next(self._numbers)
        self._opened[number] = opened
        while len(self._opened) > MAX_OPENED:
            del self._opened[min(self._opened)]
        self._searches = {
            key: task for key, task in self._searches.items() if not task.done() or self._holds(task)
        }
        return number

    def opened(self, number: int) -> OpenedSource:
        """Return an opened source.

        Raises:
            BadInput: If it has been dropped for newer ones.
        """
        if number not in self._opened:
            raise BadInput("this source has been closed; open it again")
        return self._opened[number]

    def default_path(self, source: str) -> str:
        """Return the path that is proposed for a source's registration."""
        path = Path(source)
        folder = path.parent if self._site.is_local and path.exists() else Path()
        return str(folder / "registration.toml")

    def load(self, number: int, path: str) -> Draft:
        """Read a registration file as a draft, to be corrected over an opened source.

        Raises:
            BadInput: If it cannot be read, or is for images of another size.
        """
        opened, file = self.opened(number), self._file(path)
        try:
            return draft_from(load_camera_registration(file), file.name, opened)
        except BadInput as error:
            raise BadInput(error.problem, file, error.place) from None

    def save(self, number: int, draft: Draft, path: str, *, picture: bool, overwrite: bool) -> list[str]:
        """Write a draft as a registration, with a picture if wanted; return the paths.

        Raises:
            FileExists: If a file exists and `overwrite` is False.
            BadInput: If the draft is invalid or cannot be written; nothing is written then.
        """
        opened = self.opened(number)
        file = self._file(path)
        if file.suffix != ".toml":
            raise BadInput("the name of a registration ends in .toml", path or "''")
        contents = {file: checked_registration(opened, draft).text.encode()}
        if picture:
            contents[file.with_suffix(".png")] = draft_picture(opened, draft)
        for each in contents:
            _check_writable(each, opened.source, overwrite=overwrite)
        try:
            write_files(tuple(contents), tuple(contents.values()))
        except OSError as error:
            raise BadInput(f"cannot be written ({error.strerror})", file) from None
        return [str(each) for each in contents]

    def _file(self, path: str) -> Path:
        return Path(path).expanduser() if self._site.is_local else Path(self._permitted(path))

    async def _find_eye(self, source: str, mirrored: bool, diameter_mm: float) -> OpenedSource:
        images = await self._images_of_loop(source)
        job = self._jobs.run("register", source, self._site.source_config, images, mirrored, diameter_mm)
        async with aclosing(job):  # at once, because a task keeps its error and what that refers to
            async for content, data in job:
                if content["type"] == "opened":
                    opened: OpenedSource = pickle.loads(data)
                elif content["type"] == "progress":
                    self.progress = _progress_text(content)
                else:
                    raise BadInput(content["problem"])
        return opened

    async def _images_of_loop(self, source: str) -> list[Image]:
        """Collect images from the loop for some seconds, if it uses a source that cannot be opened twice."""
        is_used = source == self._site.source and self._site.on_registration is None
        if not is_used or split_source(source, SOURCES)[0] not in LIVE:
            return []
        images: dict[int, Image] = {}
        end_s = time.monotonic() + OBSERVE_S
        while time.monotonic() < end_s:
            capture = self._site.hub.newest_capture
            if capture is not None and capture.image is not None:
                images[capture.index] = capture.image
            await asyncio.sleep(POLL_S)
        if not images:
            raise BadInput("the loop currently receives no images from it", source)
        return list(images.values())

    def _permitted(self, path: str) -> str:
        """Return a path if clients of other machines may use it."""
        folder = Path().resolve()
        has_scheme = path.partition(":")[0] in SOURCES
        if path == self._site.source or (not has_scheme and Path(path).resolve().is_relative_to(folder)):
            return path
        raise BadInput(
            "served to other machines, this page uses only files in haptigraph's working folder, "
            "and the source that haptigraph runs on",
            path,
        )


def _check_writable(file: Path, source: str, *, overwrite: bool) -> None:
    if file.is_dir():
        raise BadInput("is a folder; give the name of a file", file)
    if not file.parent.is_dir():
        raise BadInput("its folder does not exist", file)
    if file.exists() and Path(source).exists() and file.samefile(source):
        raise BadInput("is the source itself; give the registration another name", file)
    if file.exists() and not overwrite:
        raise FileExists("already exists", file)


def _progress_text(progress: dict[str, Any]) -> str:
    return f"{progress['what']}: {progress['done']} images" if progress["done"] else str(progress["what"])
