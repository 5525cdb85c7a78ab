"""The job that reads images of a source and finds the anatomy that a registration needs."""

import pickle
import time
from collections.abc import Generator, Sequence
from contextlib import closing

from msgspec.structs import replace

from haptigraph.analysis.registering.draft import open_images
from haptigraph.analysis.registering.registering import all_images, recorded_turn, spread_images
from haptigraph.assemble import SOURCES, is_live, open_source
from haptigraph.clock import MonotonicClock
from haptigraph.config import Config, SourceConfig
from haptigraph.dashboard.server.stream import send_message
from haptigraph.errors import BadInput, SourceLost
from haptigraph.messages import Image
from haptigraph.sources.naming import split_source

__all__ = ["OBSERVE_S", "find_eye"]

MAX_IMAGES = 40
OBSERVE_S = 4.0
"""Time to watch a live source."""
TIMEOUT_S = 0.1
CAMERA_PX = 1280, 720  # preferred; a camera delivers the nearest size it can


def find_eye(
    source: str, source_config: SourceConfig, images: Sequence[Image], mirrored: bool, diameter_mm: float
) -> None:
    """Send the opened source, pickled.

    Args:
        source: The source to read.
        source_config: Settings of a camera; how images are turned.
        images: Images of a source that cannot be read from here; else empty.
        mirrored: Whether the camera looks through a mirror.
        diameter_mm: Inner diameter of the globe.
    """
    with closing(_images(source, source_config, images)) as found:
        picked = spread_images(found, source, MAX_IMAGES, _send_progress)
    _send_progress(f"finding the eye in {len(picked)} images")
    turn = (None if images else recorded_turn(source)) or source_config.turn
    opened = open_images(picked, source, mirrored=mirrored, diameter_mm=diameter_mm, turn=turn)
    send_message({"type": "opened"}, pickle.dumps(opened))


def _send_progress(what: str, done: int = 0, total: int = 0) -> None:
    send_message({"type": "progress", "what": what, "done": done, "total": total})


def _images(
    source: str, source_config: SourceConfig, images: Sequence[Image]
) -> Generator[Image, None, None]:
    kind = "" if images else split_source(source, SOURCES)[0]
    if images:
        yield from images
    elif is_live(kind):
        yield from _camera_images(replace(source_config, uri=source, loop=False))
    elif kind == "teleop":
        raise BadInput(f"{source} has no end; use phantom:SCENARIO")
    else:
        yield from all_images(source, source_config.turn)


def _camera_images(source_config: SourceConfig) -> Generator[Image, None, None]:
    """Yield a camera's images for some seconds."""
    size_px = (source_config.width_px, source_config.height_px) if source_config.width_px else CAMERA_PX
    turned_px = source_config.turn.size_before_px(size_px)  # which swaps back, too
    with closing(open_source(Config(source=source_config), MonotonicClock(), turned_px)) as camera:
        end_s = time.monotonic() + OBSERVE_S
        while time.monotonic() < end_s:
            try:
                capture = camera.read(TIMEOUT_S)
            except SourceLost as error:
                raise BadInput(str(error)) from None
            if capture is not None and capture.image is not None:
                yield capture.image
