"""Whether the lengths in a B-scan stay the same when it is resampled: a part of `bscan.py`."""

import math
from collections import defaultdict
from collections.abc import Iterable
from typing import NamedTuple

import cv2
import numpy as np

from haptigraph.config import PerceptionConfig
from haptigraph.geometry import Point, Polyline, height_on_polyline
from haptigraph.messages import Capture, Image, Observation
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.oct import ScanRegistration
from haptigraph.sim.oct.bscan import BscanTruth, ScanSettings
from haptigraph.sim.oct.scenes import BscanScene

SIZES = 0.7, 1.5, 2.0
"""To which B-scans are resampled, relative to their own."""
MOST_CHANGED = 0.05
"""Required of every length."""
ABOVE_PX = 2  # a tip further above the ILM is above the retina


class Lengths(NamedTuple):
    """What is measured below a tip [mm]."""

    above_rpe_mm: float
    """Height of the tip."""
    thickness_mm: float
    """Of the retina."""


def registration_of(settings: ScanSettings, image: Image) -> ScanRegistration:
    """Return the registration of a B-scan that has any number of pixels."""
    height, width = image.shape
    text = (
        f"format = 1\n[image]\nwidth = {width}\nheight = {height}\n[scale]\n"
        f"axial_mm_per_px = {settings.axial_mm_per_px * settings.height_px / height}\n"
        f"lateral_mm_per_px = {settings.lateral_mm_per_px * settings.width_px / width}\n"
    )
    registration = parse_registration(text, "scene")
    assert isinstance(registration, ScanRegistration)  # noqa: S101 - for the type checker
    return registration


def is_above(truth: BscanTruth) -> bool:
    """Return whether there is a tip above the retina."""
    if truth.needle is None:
        return False
    column = min(max(round(truth.needle.tip_px[0]), 0), len(truth.ilm_px) - 1)
    return bool(truth.needle.tip_px[1] < truth.ilm_px[column] - ABOVE_PX)


def compare(perceiver: type, lines: Iterable[tuple[str, Iterable[BscanScene]]]) -> None:
    """Print how the lengths change, by line, over the scenes with a tip above the retina.

    Args:
        perceiver: Class of the perceiver.
        lines: Names and scenes.
    """
    changes: dict[float, list[Lengths]] = defaultdict(list)  # relative, by size
    known = once = 0
    for name, scenes in lines:
        for number, scene in enumerate(scenes):
            scan = scene.take()
            own = _lengths(perceiver, scene, scan.image) if is_above(scan.truth) else None
            known += own is not None
            for size in SIZES if own else ():
                other = _lengths(perceiver, scene, _resampled(scan.image, size))
                if other is None:
                    once += 1
                    print(f"{name}, scene {number}, {size} x: not known")
                    continue
                change = Lengths(*(new / old - 1 for new, old in zip(other, own or (), strict=True)))
                changes[size].append(change)
                if max(map(abs, change)) > MOST_CHANGED:
                    text = (
                        f"RPE {100 * change.above_rpe_mm:+.1f} %, retina {100 * change.thickness_mm:+.1f} %"
                    )
                    print(f"{name}, scene {number}, {size} x: {text}")
    for size, of_size in changes.items():
        shares = np.abs(of_size)
        columns = zip(*np.percentile(shares, (50, 95, 100), axis=0), strict=True)
        texts = (
            f"{name} {100 * p50:.2f} {100 * p95:.2f} {100 * most:.1f} %"
            for name, (p50, p95, most) in zip(Lengths._fields, columns, strict=True)
        )
        print(f"{size} x, median, 95 % and largest change: {', '.join(texts)}")
    shares = np.abs(
        [change for of_size in changes.values() for change in of_size] or [Lengths(math.nan, math.nan)]
    )
    changed, images = int(np.sum(shares > MOST_CHANGED)), known * len(SIZES)
    print(f"{known} scenes with a tip above the retina; no longer known in {once} of {images} images")
    print(f"{changed} of {shares.size} lengths change by more than {MOST_CHANGED:.0%} (required: none)")


def _resampled(image: Image, size: float) -> Image:
    height, width = (round(size * pixels) for pixels in image.shape)
    method = cv2.INTER_AREA if size < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(image, (width, height), interpolation=method), np.uint8)


def _lengths(perceiver: type, scene: BscanScene, image: Image) -> Lengths | None:
    """Return the lengths in a B-scan; None if the tip or a surface is not known."""
    perceive = perceiver(registration_of(scene.scan, image), PerceptionConfig())
    observation: Observation = perceive(Capture(0, 0, image))
    tip, ilm, rpe = (observation.found.get(name) for name in ("needle_tip", "ilm", "rpe"))
    if not (isinstance(tip, Point) and isinstance(ilm, Polyline) and isinstance(rpe, Polyline)):
        return None
    x, y = tip.at_mm
    floor_mm = height_on_polyline(x, rpe)
    return Lengths(y - floor_mm, height_on_polyline(x, ilm) - floor_mm)
