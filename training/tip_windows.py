"""What the tip network learns from: simulated scenes -> windows along shafts, true tips.

The tracker follows each needle without the network. Each window lies about a place near or beside the tip
that it selected, so that the network learns to find the tip, not to trust that place.
"""

import zlib
from collections.abc import Iterable, Iterator
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks import degraded
from haptigraph.analysis.evaluation.sweep import play
from haptigraph.config import PerceptionConfig
from haptigraph.errors import BadInput
from haptigraph.geometry import Vec
from haptigraph.imaging import FloatImage
from haptigraph.messages import Image, Truth
from haptigraph.perception.native.tip_network import judge_tip, tip_window
from haptigraph.perception.needle.rectify import Line
from haptigraph.perception.needle.tip_selection import Detection
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.registration.loading import parse_camera_registration
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.sweep_scenes import sweep_scene
from training.tip_shape import FAR_MM, FAR_PX

__all__ = ["VARIANTS", "Follower", "Judged", "Window", "Windows", "of_scene"]

NEAR_MM = 0.9  # from the selected tip, where another window is
WIDE_MM = -4.0, 2.5  # where one more is, to learn what is no tip


Window: TypeAlias = tuple[NDArray[np.float16], float, tuple[float, float, float]]
"""Its values, how far the true tip is beyond its place [mm], and its context, as `tip_places` has it."""
Judged: TypeAlias = tuple[float, bool, float]
"""How probably a tip is far from where it is reported, by its own image; if it is; its error in sds."""


class Windows(NamedTuple):
    """Windows of one clip or scene: by turns at the selected tip, near it, and further from it."""

    values: NDArray[np.float16]
    """(n, VALUES)."""
    beyond_mm: NDArray[np.float32]
    """How far the true tip is beyond the window's place, (n,)."""
    context: NDArray[np.float32]
    """(n, 3)."""

    @classmethod
    def of(cls, found: Iterable[Window]) -> "Windows":
        """Return single windows together."""
        values, beyond_mm, context = zip(*found, strict=True)
        return cls(np.array(values), np.array(beyond_mm, np.float32), np.array(context, np.float32))


class Follower(Tracker):
    """The tracker without its network."""

    def windows(
        self, detection: Detection | None, tip_px: Vec | None, rng: np.random.Generator
    ) -> Iterator[Window]:
        """Yield the windows of one image.

        Args:
            detection: What was measured.
            tip_px: The true tip; None if it is not visible inside.
            rng: For the places of those beside the selected tip.
        """
        if detection is None or detection.tip.where != "inside" or tip_px is None:
            return
        scale, fit, tip = self._eye.px_per_mm, detection.fit, detection.tip
        true_px, strip = self._along_px(detection.line, tip_px), detection.candidate.strip
        for off_mm in (0.0, rng.uniform(-NEAR_MM, NEAR_MM), rng.uniform(*WIDE_MM)):
            at_px = tip.u_px + off_mm * scale
            values = tip_window(strip, fit.offset_px, fit.slope, at_px, scale)
            context = strip.noise_grey, scale, tip.sd_px
            yield values.astype(np.float16), (true_px - at_px) / scale, context

    def judged(self, detection: Detection, tip_px: Vec, weights: FloatImage) -> Judged:
        """Return what the network says about a tip that was selected, beside the truth.

        Args:
            detection: What was measured, of a tip inside.
            tip_px: The true tip.
            weights: What the network has learned.
        """
        scale, fit, tip = self._eye.px_per_mm, detection.fit, detection.tip
        line, selected = (fit.offset_px, fit.slope), (tip.u_px, tip.sd_px)
        beyond_mm, sd_mm, far = judge_tip(detection.candidate.strip, weights, line, selected, scale)
        off_mm = (self._along_px(detection.line, tip_px) - tip.u_px) / scale - beyond_mm
        return far, abs(off_mm) > max(FAR_MM, FAR_PX / scale), abs(off_mm) / sd_mm

    def _along_px(self, line: Line, at_px: Vec) -> float:
        """Return where along a line a place is."""
        (x, y), (dx, dy) = line.at_px(self._eye.trocar_px, 0.0), line.direction
        return (at_px[0] - x) * dx + (at_px[1] - y) * dy


def of_scene(number: int, seed: int, size_px: tuple[int, int] = (1280, 720)) -> Windows | None:
    """Return the windows of one simulated scene; None if no tip is inside, or the globe is too small."""
    phantom = Phantom(sweep_scene(number, seed, size_px=size_px).scenario)
    try:
        registration = parse_camera_registration(phantom.registration, "the scene's registration")
    except BadInput:
        return None
    follower = Follower(registration, PerceptionConfig(), uses_network=False)
    rng = np.random.default_rng(zlib.crc32(f"{seed} {number}".encode()))
    found = [
        window
        for capture, moment in play(phantom)
        for window in follower.windows(
            follower.detect(moment.image, capture.stamp_ns), _tip_inside(moment.truth), rng
        )
    ]
    return Windows.of(found) if found else None


def _tip_inside(truth: Truth) -> Vec | None:
    """Return a true tip that is visible inside the globe."""
    return truth.tip_px if truth.visible and truth.inside else None


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
"""How rendered images are degraded; those that begin with `half` have half the width and height."""
