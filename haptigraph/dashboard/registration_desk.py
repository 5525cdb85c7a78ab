"""Where registrations are made: reads sources, keeps what was found in them, writes files.

Knows no HTTP. Others than this machine may read and write in the working folder only.
"""

import json
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from itertools import count
from pathlib import Path

from haptigraph.analysis.registering import all_images, spread_images, write_files
from haptigraph.analysis.registration_draft import Draft, Opened, open_images, sound_registration
from haptigraph.assemble import SOURCES, open_source
from haptigraph.clock import MonotonicClock
from haptigraph.config import load_config
from haptigraph.dashboard.aside import aside
from haptigraph.dashboard.hub import Hub
from haptigraph.dashboard.site import Site
from haptigraph.errors import BadInput, SourceLost
from haptigraph.messages import Image

__all__ = ["Desk", "ExistsAlready"]

LIVE = ("camera", "teleop")  # what has no end, and cannot be opened twice
MOST_OPENED = 4
MOST_IMAGES = 40
LOOK_S = 4.0  # at what is live
GLANCE_S = 0.1
CAMERA_PX = 1280, 720  # to ask for; a camera delivers the nearest it can


class ExistsAlready(BadInput):
    """A file stands where another is to be written."""


class Desk:
    """Keep the sources that were opened last, by number.

    Args:
        site: Says what runs now, and who may come.
    """

    def __init__(self, site: Site) -> None:
        self.progress = ""
        """What is being done, for people who wait."""
        self._site = site
        self._numbers = count(1)
        self._opened: dict[int, Opened] = {}

    def open(self, source: str, *, mirrored: bool, diameter_mm: float) -> int:
        """Look at a source; takes seconds. Returns its number.

        Raises:
            BadInput: If it cannot be read. That nothing is found in it is no error.
        """
        source = source if self._site.is_local else self._permitted(source)
        self.progress = "opening"
        try:
            seen = self._seen(source)
            opened = aside(_looked_at, source, seen, mirrored, diameter_mm, progress=self._tell)
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

    def save(self, number: int, draft: Draft, path: str, *, overwrite: bool) -> str:
        """Write a draft as a registration; return its path.

        Raises:
            ExistsAlready: If the file exists and may not be overwritten.
            BadInput: If a run would refuse the draft, or it cannot be written; nothing is written then.
        """
        text = sound_registration(self.opened(number), draft).text
        file = Path(path).expanduser() if self._site.is_local else Path(self._permitted(path))
        if file.suffix != ".toml":
            raise BadInput("the name of a registration ends in .toml", path or "''")
        if file.is_dir():
            raise BadInput("is a folder; the name of a file is needed", file)
        if not file.parent.is_dir():
            raise BadInput("its folder does not exist", file)
        if file.exists() and not overwrite:
            raise ExistsAlready("exists already", file)
        try:
            write_files((file,), (text.encode(),))
        except OSError as error:
            raise BadInput(f"cannot be written ({error.strerror})", file) from None
        return str(file)

    def _tell(self, what: str) -> None:
        self.progress = what

    def _seen(self, source: str) -> list[Image]:
        """Return what the loop sees of a source that nobody else can look at meanwhile."""
        runs = source == self._site.source and self._site.on_registration is None
        if not runs or source.partition(":")[0] not in LIVE:
            return []
        seen = list(_from_loop(self._site.hub))
        if not seen:
            raise BadInput("the loop gets no images from it just now", source)
        return seen

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


def _looked_at(
    source: str, seen: Sequence[Image], mirrored: bool, diameter_mm: float, tell: Callable[[str], None]
) -> Opened:
    """Read a source, or take what was seen of it, and find the anatomy."""
    with closing(_images(source, seen)) as images:
        picked = spread_images(
            images,
            source,
            MOST_IMAGES,
            lambda what, done, _: tell(f"{what}: {done} images" if done else what),
        )
    tell(f"looking for the eye in {len(picked)} images")
    return open_images(picked, source, mirrored=mirrored, diameter_mm=diameter_mm)


def _images(source: str, seen: Sequence[Image]) -> Generator[Image, None, None]:
    kind = source.partition(":")[0]
    if seen:
        yield from seen
    elif kind == "camera":
        yield from _from_camera(source)
    elif kind == "teleop":
        raise BadInput(f"{source} has no end; give phantom:SCENARIO")
    else:
        yield from all_images(source)


def _from_loop(hub: Hub) -> Generator[Image, None, None]:
    """Take what the loop sees for some seconds."""
    last = -1
    end_s = time.monotonic() + LOOK_S
    while time.monotonic() < end_s:
        capture = hub.newest_capture
        if capture is not None and capture.image is not None and capture.index != last:
            last = capture.index
            yield capture.image
        time.sleep(GLANCE_S)


def _from_camera(source: str) -> Generator[Image, None, None]:
    """Look through a camera for some seconds."""
    config = load_config(None, (f"source.uri={json.dumps(source)}",))
    with closing(open_source(config, MonotonicClock(), CAMERA_PX)) as camera:
        end_s = time.monotonic() + LOOK_S
        while time.monotonic() < end_s:
            try:
                capture = camera.read(GLANCE_S)
            except SourceLost as error:
                raise BadInput(str(error)) from None
            if capture is not None and capture.image is not None:
                yield capture.image
