"""What the tip network learns from: labelled clips and simulated scenes -> windows along shafts, true tips.

The tracker follows each needle without the network. Each window lies about a place near or beside the tip
that it selected, so that the network learns to find the tip, not to trust that place.
"""

import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks import degraded
from haptigraph.analysis.evaluation.ground_truth import TruthRow, load_truth
from haptigraph.analysis.evaluation.sweep import play
from haptigraph.config import PerceptionConfig
from haptigraph.errors import BadInput
from haptigraph.geometry import Vec
from haptigraph.messages import Image, Truth
from haptigraph.perception.native.tip_network import tip_window
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import load_camera_registration, parse_camera_registration
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.sweep_scenes import sweep_scene

__all__ = ["VARIANTS", "Window", "Windows", "of_clip", "of_scene"]

NEAR_MM, NEAR = 0.9, 3  # from the selected tip, and number of windows there
WIDE_MM = -4.0, 6.0  # where one more is, to learn what is no tip


Window: TypeAlias = tuple[NDArray[np.float16], float, float]
"""Its values, how far the true tip is beyond its place [mm], and the noise [grey levels]."""


class Windows(NamedTuple):
    """Windows of one clip or scene."""

    values: NDArray[np.float16]
    """(n, VALUES)."""
    beyond_mm: NDArray[np.float32]
    """How far the true tip is beyond the window's place, (n,)."""
    noise_grey: NDArray[np.float32]
    """(n,)."""

    @classmethod
    def of(cls, found: Iterable[Window]) -> "Windows":
        """Return single windows together."""
        values, beyond_mm, noise_grey = zip(*found, strict=True)
        return cls(np.array(values), np.array(beyond_mm, np.float32), np.array(noise_grey, np.float32))


class _Follower(Tracker):
    """The tracker without its network."""

    def windows(
        self, image: Image, stamp_ns: int, tip_px: Vec | None, rng: np.random.Generator
    ) -> Iterator[Window]:
        """Yield the windows of one image."""
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
    follower = _Follower(registration, PerceptionConfig(), uses_network=False)
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    found = [
        window
        for stamp_ns, image, tip_px in images
        for window in follower.windows(image, stamp_ns, tip_px, rng)
    ]
    return Windows.of(found) if found else None


def of_scene(number: int, seed: int, size_px: tuple[int, int] = (1280, 720)) -> Windows | None:
    """Return the windows of one simulated scene; None if no tip is inside, or the globe is too small."""
    phantom = Phantom(sweep_scene(number, seed, size_px=size_px).scenario)
    try:
        registration = parse_camera_registration(phantom.registration, "the scene's registration")
    except BadInput:
        return None
    images = (
        (capture.stamp_ns, moment.image, _tip_inside(moment.truth)) for capture, moment in play(phantom)
    )
    return _collect(registration, images, f"{seed} {number}")


def _tip_inside(row: Truth | TruthRow) -> Vec | None:
    """Return a true tip that is visible inside the globe."""
    return row.tip_px if row.visible and row.inside else None


def of_clip(folder: Path, variant: str) -> Windows | None:
    """Return the windows of one labelled clip whose images are degraded as a variant says."""
    registration = load_camera_registration(folder / "registration.toml")
    truth = load_truth(folder / "truth.csv")
    if variant.startswith("half"):
        registration = degraded.halved_registration(registration, folder)
        truth = [degraded.halved_truth(row) for row in truth]
    captures = degraded.captures_of(folder, variant, VARIANTS[variant])
    images = (
        (capture.stamp_ns, registration.checked(capture.image), _tip_inside(row))
        for capture, row in zip(captures, truth, strict=False)
    )
    return _collect(registration, images, f"{folder.name} {variant}")


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
    "moved across": degraded.moving(7, 110),
    "moved and noisy": _chain(degraded.moving(11, -40), degraded.adding_noise(4)),
    "less noisy": degraded.adding_noise(6),
    "noisier": degraded.adding_noise(18),
    "less compressed": degraded.compressing(50),
    "noisy and compressed": _chain(degraded.adding_noise(5), degraded.compressing(35)),
    "blurred": _chain(_blurred, degraded.adding_noise(2)),
    "dark": _chain(_dark, degraded.adding_noise(4)),
    "half and noisy": _chain(degraded.halved, degraded.adding_noise(7)),
    "half and compressed": _chain(degraded.halved, degraded.compressing(50)),
}
"""How labelled clips are degraded; those that begin with `half` have half the width and height."""
