"""Windows from scenes drawn by lot: what was rendered about tips -> windows, or judgements, and true tips.

Few scenes can be rendered whole. Of a drawn scene there is only what is about each tip, so the tracker cannot
follow the needle. It expects each one about where it truly is; then it measures and selects as always.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.random import Generator

from benchmarks import degraded
from haptigraph.config import PerceptionConfig
from haptigraph.geometry import Vec, subtract
from haptigraph.imaging import FloatImage
from haptigraph.messages import Image
from haptigraph.perception.needle.rectify import EyeGeometry, Line
from haptigraph.perception.needle.tip_selection import Detection
from haptigraph.registration.loading import parse_camera_registration
from rendering.labels import registration_of
from rendering.layout import HEIGHT_PX, WIDTH_PX, Box, Layout, Placed
from rendering.lot import drawn_scene
from rendering.pack import Sensor, write_clip
from rendering.tips import AROUND, EMPTY, FOLDER, Part, file_of, parts_of
from training.tip_windows import VARIANTS, Follower, Judged, Windows

__all__ = ["check_rendered", "is_rendered", "judged_in", "of_drawn"]

AWAY_IMAGES = 2  # the background, and what is beside each rendered part
OFFSET_SD_PX, ANGLE_SD_DEG = 1.0, 0.15  # of the line that the tracker expects
EXPECTED_SD_MM, LOST_SD_MM, LOST = 0.2, 0.8, 0.2  # of the expected tip, mostly, and the share of others
INSET_PX = 8  # of a part's margin, which blur makes different


class _Measured(NamedTuple):
    """One needle in one variant."""

    follower: Follower
    detection: Detection | None
    tip_px: Vec
    rng: Generator


def is_rendered(number: int) -> bool:
    """Return whether all images of a drawn scene were rendered."""
    return all(file_of(number, name).exists() for name in parts_of(Layout(drawn_scene(number))))


def check_rendered(program: str, numbers: Sequence[int], target: str) -> None:
    """Check that drawn scenes are rendered.

    Args:
        program: Which needs them.
        numbers: Of the scenes.
        target: What `make` renders them with.

    Raises:
        SystemExit: If one is not.
    """
    missing = [number for number in numbers if not is_rendered(number)]
    if missing:
        raise SystemExit(
            f"{program}: {len(missing)} of {len(numbers)} scenes are not rendered; make {target}"
        )


def of_drawn(number: int) -> Windows:
    """Return the windows of one drawn scene, in all variants."""
    found = (each.follower.windows(each.detection, each.tip_px, each.rng) for each in _measured(number))
    return Windows.of(chain.from_iterable(found))


def judged_in(number: int, weights: FloatImage) -> list[Judged]:
    """Return what a network says about the tips in one drawn scene, in all variants.

    Args:
        number: Of the scene.
        weights: What the network has learned.
    """
    return [
        follower.judged(detection, tip_px, weights)
        for follower, detection, tip_px, _ in _measured(number)
        if detection is not None and detection.tip.where == "inside"
    ]


def _measured(number: int) -> Iterator[_Measured]:
    """Yield what the tracker measures of each needle of a drawn scene, in all variants."""
    layout, clip = Layout(drawn_scene(number)), FOLDER / f"{number:04d}"
    parts = parts_of(layout)
    write_clip(clip / "clip.mp4", _images(number, layout, parts))
    captures = degraded.captures_of(clip, "full", degraded.unchanged)
    images = [np.asarray(capture.image, np.uint8) for capture in captures]
    needles = [(layout.placed(pose), box) for pose, box in parts.values() if pose and box]
    for variant in VARIANTS:
        yield from _of_variant(layout, needles, images, variant)


def _images(number: int, layout: Layout, parts: Mapping[str, Part]) -> Iterator[Image]:
    """Yield the images of a clip: the empty eye, then each needle in it."""
    around = cv2.resize(_read(number, AROUND), (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_CUBIC)
    (_, whole_box), sensor = parts[EMPTY], Sensor(layout.scene.seed)
    empty = _with_part(around, _read(number, EMPTY), whole_box)
    for _ in range(AWAY_IMAGES):
        yield sensor(empty)
    for name, (pose, box) in parts.items():
        if pose:
            yield sensor(_with_part(empty, _read(number, name), box))


def _read(number: int, name: str) -> Image:
    return np.asarray(cv2.imread(str(file_of(number, name))), np.uint8)


def _with_part(image: Image, part: Image, box: Box | None, inset_px: int = 1) -> Image:
    """Return an image with a part in its place, without the part's margin."""
    left, top, right, bottom = box or (0, 0, WIDTH_PX, HEIGHT_PX)
    inner = np.s_[inset_px:-inset_px, inset_px:-inset_px]
    whole = image.copy()
    whole[top:bottom, left:right][inner] = part[: bottom - top, : right - left][inner]
    return whole


def _of_variant(
    layout: Layout, needles: Sequence[tuple[Placed, Box]], images: Sequence[Image], variant: str
) -> Iterator[_Measured]:
    """Yield what is measured of all needles of a scene in one variant."""
    rng, degrade = np.random.default_rng([layout.scene.seed, *variant.encode()]), VARIANTS[variant]
    smaller, registration = 1, parse_camera_registration(registration_of(layout), "the scene's registration")
    if variant.startswith("half"):
        smaller, registration = 2, degraded.halved_registration(registration, Path(variant))
    follower = _Follower(registration, PerceptionConfig(), uses_network=False)
    follower.begin(degrade(images[0], rng))
    beside = degrade(images[1], rng)
    for (each, (left, top, right, bottom)), image in zip(needles, images[AWAY_IMAGES:], strict=True):
        part = degrade(image[top:bottom, left:right], rng)
        box = left // smaller, top // smaller, right // smaller, bottom // smaller
        shown = _with_part(beside, part, box, INSET_PX // smaller)
        ends_px = [layout.to_px(at_mm, each.behind_mm) for at_mm in (layout.eye.trocar_mm, each.axis_mm)]
        tip_px = layout.to_px(each.tip_mm, each.behind_mm)
        if smaller == 2:
            ends_px, tip_px = [degraded.halved_px(at_px) for at_px in ends_px], degraded.halved_px(tip_px)
        yield _Measured(follower, follower.measured(shown, ends_px, rng), tip_px, rng)


class _Follower(Follower):
    """A tracker that expects each needle about where it truly is."""

    def begin(self, image: Image) -> None:
        """Begin with the empty eye."""
        self._background.learn(image, None, 0)

    def measured(self, image: Image, ends_px: Sequence[Vec], rng: Generator) -> Detection | None:
        """Return what it measures of the needle whose axis has these ends."""
        line = _line(self._eye, ends_px, rng)
        (x, y), (dx, dy) = line.at_px(self._eye.trocar_px, 0.0), line.direction
        depth_px = (ends_px[1][0] - x) * dx + (ends_px[1][1] - y) * dy
        sd_mm = LOST_SD_MM if rng.random() < LOST else EXPECTED_SD_MM
        self._focus.measure(image)
        detection = self._track(image, line, depth_px + rng.normal(0, sd_mm) * self._eye.px_per_mm)
        self._update_filter(detection)
        return detection


def _line(eye: EyeGeometry, ends_px: Sequence[tuple[float, float]], rng: Generator) -> Line:
    """Return the line through two points, a little off."""
    (x, y), (dx, dy) = ends_px[0], subtract(ends_px[1], ends_px[0])
    angle_rad = math.atan2(dy, dx)
    off_x, off_y = x - eye.trocar_px[0], y - eye.trocar_px[1]
    offset_px = off_y * math.cos(angle_rad) - off_x * math.sin(angle_rad)
    turned_rad = math.radians(rng.normal(0, ANGLE_SD_DEG))
    return Line(angle_rad + turned_rad, float(offset_px + rng.normal(0, OFFSET_SD_PX)))
