"""The job that looks at a source and finds what a registration needs."""

import pickle
import time
from collections.abc import Generator, Sequence
from contextlib import closing

from msgspec.structs import replace

from haptigraph.analysis.registering.draft import open_images
from haptigraph.analysis.registering.registering import all_images, spread_images
from haptigraph.assemble import SOURCES, open_source
from haptigraph.clock import MonotonicClock
from haptigraph.config import Config, SourceConfig
from haptigraph.dashboard.server.frames import put_frame
from haptigraph.errors import BadInput, SourceLost
from haptigraph.messages import Image
from haptigraph.sources.naming import CAMERAS, split_source

__all__ = ["LOOK_S", "look_at"]

MOST_IMAGES = 40
LOOK_S = 4.0
"""At what is live."""
TRY_S = 0.1
CAMERA_PX = 1280, 720  # to ask for; a camera delivers the nearest it can


def look_at(
    source: str, asked: SourceConfig, seen: Sequence[Image], mirrored: bool, diameter_mm: float
) -> None:
    """Answer with what was found, pickled.

    Args:
        source: What to read.
        asked: What to ask of a camera.
        seen: Images of it, if it cannot be read from here; else empty.
        mirrored: Whether it is seen through a mirror.
        diameter_mm: Inner diameter of the globe.
    """
    with closing(_images(source, asked, seen)) as images:
        picked = spread_images(images, source, MOST_IMAGES, _tell)
    _tell(f"looking for the eye in {len(picked)} images")
    opened = open_images(picked, source, mirrored=mirrored, diameter_mm=diameter_mm)
    put_frame({"type": "opened"}, pickle.dumps(opened))


def _tell(what: str, done: int = 0, total: int = 0) -> None:
    put_frame({"type": "progress", "what": what, "done": done, "total": total})


def _images(source: str, asked: SourceConfig, seen: Sequence[Image]) -> Generator[Image, None, None]:
    kind = "" if seen else split_source(source, SOURCES)[0]
    if seen:
        yield from seen
    elif kind in CAMERAS:
        yield from _from_camera(replace(asked, uri=source, loop=False))
    elif kind == "teleop":
        raise BadInput(f"{source} has no end; give phantom:SCENARIO")
    else:
        yield from all_images(source)


def _from_camera(asked: SourceConfig) -> Generator[Image, None, None]:
    """Look through a camera for some seconds."""
    size_px = (asked.width_px, asked.height_px) if asked.width_px else CAMERA_PX
    with closing(open_source(Config(source=asked), MonotonicClock(), size_px)) as camera:
        end_s = time.monotonic() + LOOK_S
        while time.monotonic() < end_s:
            try:
                capture = camera.read(TRY_S)
            except SourceLost as error:
                raise BadInput(str(error)) from None
            if capture is not None and capture.image is not None:
                yield capture.image
