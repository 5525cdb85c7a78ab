"""What the tip network learns from: labelled clips and simulated scenes -> windows along shafts, true tips.

The tracker follows each needle without the network. Each window lies about a place near or beside the tip
that it selected, so that the network learns to find the tip, not to trust that place.
"""

import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks import degraded
from haptigraph.analysis.evaluation.ground_truth import load_truth
from haptigraph.analysis.evaluation.sweep import play
from haptigraph.config import PerceptionConfig
from haptigraph.errors import BadInput
from haptigraph.geometry import Vec
from haptigraph.messages import Image
from haptigraph.perception.native.tip_network import tip_window
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import load_camera_registration, parse_camera_registration
from haptigraph.sim.eye.motion_blur import line_kernel
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.sweep_scenes import sweep_scene

__all__ = ["VARIANTS", "Windows", "of_clip", "of_scene"]

NEAR_MM, NEAR = 0.9, 3  # from the selected tip, and number of windows there
WIDE_MM = -4.0, 6.0  # where one more is, to learn what is no tip


class Windows(NamedTuple):
    """Windows of one clip or scene."""

    values: NDArray[np.float16]
    """(n, VALUES)."""
    beyond_mm: NDArray[np.float32]
    """How far the true tip is beyond the window's place, (n,)."""
    noise_grey: NDArray[np.float32]
    """(n,)."""


class _Follower(Tracker):
    """The tracker without its network."""

    def windows(
        self, image: Image, stamp_ns: int, tip_px: Vec | None, rng: np.random.Generator
    ) -> Iterator[tuple[NDArray[np.float16], float, float]]:
        """Yield the windows of one image, with how far the tip is beyond their place and the noise."""
        found, scale = self.detect(image, stamp_ns), self._eye.px_per_mm
        if found is None or found.tip.where != "inside" or tip_px is None:
            return
        (x, y), (dx, dy) = found.line.at_px(self._eye.trocar_px, 0.0), found.line.direction
        true_px, strip = (tip_px[0] - x) * dx + (tip_px[1] - y) * dy, found.candidate.strip
        for off_mm in (*rng.uniform(-NEAR_MM, NEAR_MM, NEAR), rng.uniform(*WIDE_MM)):
            at_px = found.tip.u_px + off_mm * scale
            values = tip_window(strip, found.fit.offset_px, found.fit.slope, at_px, scale)
            yield values.astype(np.float16), (true_px - at_px) / scale, strip.noise_grey


def _collect(
    registration: Registration, images: Iterable[tuple[int, Image, Vec | None]], name: str
) -> Windows | None:
    follower, rng = (
        _Follower(registration, PerceptionConfig(), uses_network=False),
        np.random.default_rng(zlib.crc32(name.encode())),
    )
    found = [
        window
        for stamp_ns, image, tip_px in images
        for window in follower.windows(image, stamp_ns, tip_px, rng)
    ]
    if not found:
        return None
    values, beyond_mm, noise_grey = zip(*found, strict=True)
    return Windows(np.array(values), np.array(beyond_mm, np.float32), np.array(noise_grey, np.float32))


def of_scene(number: int, seed: int, size_px: tuple[int, int] = (1280, 720)) -> Windows | None:
    """Return the windows of one simulated scene; None if no tip is inside, or the globe is too small."""
    phantom = Phantom(sweep_scene(number, seed, size_px=size_px).scenario)
    try:
        registration = parse_camera_registration(phantom.registration, "the scene's registration")
    except BadInput:
        return None
    images = (
        (capture.stamp_ns, moment.image, moment.truth.tip_px if _is_inside(moment.truth) else None)
        for capture, moment in play(phantom)
    )
    return _collect(registration, images, f"{seed} {number}")


def _is_inside(row: object) -> bool:
    return bool(getattr(row, "visible", False) and getattr(row, "inside", False))


def of_clip(folder: Path, variant: str) -> Windows | None:
    """Return the windows of one labelled clip whose images are degraded as a variant says."""
    registration, truth = (
        load_camera_registration(folder / "registration.toml"),
        load_truth(folder / "truth.csv"),
    )
    degrade, is_half = VARIANTS[variant], variant.startswith("half")
    if is_half:
        registration = degraded.halved_registration(registration, folder)
        truth = [degraded.halved_truth(row) for row in truth]
    captures = degraded.captures_of(folder, variant, degrade)
    images = (
        (capture.stamp_ns, registration.checked(capture.image), row.tip_px if _is_inside(row) else None)
        for capture, row in zip(captures, truth, strict=False)
    )
    return _collect(registration, images, f"{folder.name} {variant}")


def _moved(length_px: float, angle_deg: float) -> degraded.Degradation:
    kernel = line_kernel(length_px, angle_deg)
    return lambda image, _rng: np.asarray(cv2.filter2D(image, -1, kernel), np.uint8)


def _noisy(sd_grey: float) -> degraded.Degradation:
    def degrade(image: Image, rng: np.random.Generator) -> Image:
        noise = rng.standard_normal(image.shape, np.float32) * np.float32(sd_grey)
        return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)

    return degrade


def _compressed(quality: int) -> degraded.Degradation:
    def degrade(image: Image, _rng: np.random.Generator) -> Image:
        encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        return np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR), np.uint8)

    return degrade


def _blurred(image: Image, _rng: np.random.Generator) -> Image:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 1.2), np.uint8)


def _dark(image: Image, _rng: np.random.Generator) -> Image:
    return np.asarray(np.rint(image * np.float32(0.6)), np.uint8)


def _chain(*steps: degraded.Degradation) -> degraded.Degradation:
    def degrade(image: Image, rng: np.random.Generator) -> Image:
        for step in steps:
            image = step(image, rng)
        return image

    return degrade


VARIANTS: dict[str, degraded.Degradation] = {
    **degraded.VARIANTS,
    "moved across": _moved(7, 110),
    "moved and noisy": _chain(_moved(11, -40), _noisy(4)),
    "less noisy": _noisy(6),
    "noisier": _noisy(18),
    "less compressed": _compressed(50),
    "noisy and compressed": _chain(_noisy(5), _compressed(35)),
    "blurred": _chain(_blurred, _noisy(2)),
    "dark": _chain(_dark, _noisy(4)),
    "half and noisy": _chain(degraded.halved, _noisy(7)),
    "half and compressed": _chain(degraded.halved, _compressed(50)),
}
"""How labelled clips are degraded; those that begin with `half` have half the width and height."""
