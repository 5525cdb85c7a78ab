"""Read a few seconds of a source: times of all images, and some of the images."""

from collections.abc import Iterable, Iterator
from contextlib import closing

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.assemble import SOURCES, is_live, open_source
from haptigraph.clock import Clock, MonotonicClock, VirtualClock
from haptigraph.config import Config
from haptigraph.errors import BadInput, EndOfSource, SourceLost
from haptigraph.imaging import grey_of
from haptigraph.messages import Capture, Image
from haptigraph.recording.writer import Progress
from haptigraph.registration.camera import Registration
from haptigraph.run_registration import registration_of
from haptigraph.sources.naming import split_source
from haptigraph.sources.reading import SpreadImages
from haptigraph.stages import Source

__all__ = ["Clip", "clip_of", "watch"]

SPREAD_IMAGES = 9
"""Images for what stands still, evenly spread."""
CONSECUTIVE_IMAGES = 60
"""Images for what changes from one to the next."""
WARM_UP_NS = 1_000_000_000  # of a camera, whose exposure and rate settle first
READ_TIMEOUT_S = 0.2


class Clip(Struct, frozen=True, eq=False):
    """A few seconds of a source."""

    spread: tuple[Image, ...]
    """Evenly spread over its duration, (h, w, 3) or (h, w) each."""
    consecutive: tuple[Image, ...]
    """The first ones, grey, (h, w) each."""
    stamps_ns: NDArray[np.int64]
    """Of all images."""
    indices: NDArray[np.int64]
    """Numbers of all images; a camera's also count those that this program was too slow to take."""
    rate_hz: float
    """Nominal images per second."""
    is_timed: bool = True
    """Whether the stamps were measured; those of a folder of images are a setting."""
    losses: tuple[str, ...] = ()
    """Why the source was lost, each time."""


def watch(
    config: Config, given: Registration | None, duration_s: float, progress: Progress | None = None
) -> tuple[Clip, Registration]:
    """Read a source for some seconds, and return them with its registration.

    Args:
        config: Its [source] table is used.
        given: The registration; None: the source's own.
        duration_s: Of the source's own time; a shorter source is read to its end.
        progress: Called with the seconds that are read.

    Raises:
        BadInput: If the source cannot be read, or the registration is not for its images.
    """
    kind = split_source(config.source.uri, SOURCES)[0]
    clock: Clock = MonotonicClock() if is_live(kind) else VirtualClock()
    size_px = (given.width_px, given.height_px) if given else None
    losses: list[str] = []
    with closing(open_source(config, clock, size_px)) as source:
        registration = registration_of(config, source, given)
        if not isinstance(registration, Registration):
            raise BadInput(f"{config.source.uri} shows B-scans; a rig has a camera before the eye")
        captures = _captures(source, clock, duration_s, losses, progress)
        clip = clip_of(
            captures, registration, source.rate_hz, is_timed=kind not in ("images", "teleop"), losses=losses
        )
    return clip, registration


def clip_of(
    captures: Iterable[Capture],
    registration: Registration,
    rate_hz: float,
    *,
    is_timed: bool = True,
    losses: Iterable[str] = (),
) -> Clip:
    """Collect captures into a clip.

    Raises:
        BadInput: If there are fewer than two, or their size is not the registered one.
    """
    spread = SpreadImages(SPREAD_IMAGES)
    consecutive: list[Image] = []
    stamps_ns: list[int] = []
    indices: list[int] = []
    for count, capture in enumerate(captures):
        image = registration.checked(capture.image)
        stamps_ns.append(capture.stamp_ns)
        indices.append(capture.index)
        if count < CONSECUTIVE_IMAGES:
            consecutive.append(grey_of(image))
        spread.add(image)
    if len(stamps_ns) < 2:
        raise BadInput(f"{len(stamps_ns)} images arrived; at least 2 are needed")
    return Clip(
        tuple(spread.picked),
        tuple(consecutive),
        np.array(stamps_ns, np.int64),
        np.array(indices, np.int64),
        rate_hz,
        is_timed,
        tuple(losses),
    )


def _captures(
    source: Source, clock: Clock, duration_s: float, losses: list[str], progress: Progress | None
) -> Iterator[Capture]:
    """Yield the captures of some seconds; of a camera, without those in which it warms up."""
    duration_ns, first_ns = round(duration_s * 1e9), None
    opened_ns = clock.now_ns()
    while True:
        try:
            capture = source.read(READ_TIMEOUT_S)
        except EndOfSource:
            return
        except SourceLost as error:
            losses.append(str(error))
            capture = None
        if source.is_live and clock.now_ns() - opened_ns > duration_ns + 2 * WARM_UP_NS:
            return
        if capture is None or capture.image is None:
            continue
        if source.is_live and capture.stamp_ns - opened_ns < WARM_UP_NS:
            continue
        first_ns = capture.stamp_ns if first_ns is None else first_ns
        elapsed_ns = capture.stamp_ns - first_ns
        if elapsed_ns > duration_ns:
            return
        if progress is not None:
            progress("watching", min(round(elapsed_ns / 1e8), round(10 * duration_s)), round(10 * duration_s))
        yield capture
