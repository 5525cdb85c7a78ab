"""The perceiver `bscan`: ILM, RPE and needle in a B-scan, by image processing.

Turns an image (px) into positions (eye frame, mm), by shortest paths, ridges and the edge of the needle's
shadow. Every image is processed independently.
"""

import numpy as np

from haptigraph.config import PerceptionConfig
from haptigraph.imaging import grey_of
from haptigraph.messages import Capture, ImageKind, Observation
from haptigraph.perception.entities import ENTITIES
from haptigraph.perception.oct.needle import Needle, find_needle, without_needle
from haptigraph.perception.oct.scan_geometry import Layers, ObservationBuilder, Shaft
from haptigraph.perception.oct.scan_image import ScanImage, ScanScale, scan_image
from haptigraph.perception.oct.surfaces import Surfaces, find_surfaces
from haptigraph.registration.oct import ScanRegistration

__all__ = ["BscanPerceiver"]

DARK_GREY = 44.0  # largest brightness beside a needle, over the dark,
DARK_SHARE, BRIGHT_SHARE = 0.75, 0.5  # or as a share of the contrast of tissue, and of all that is bright


class BscanPerceiver:
    """Find ILM, RPE and needle.

    Args:
        registration: Size and scale of the B-scans, and the depth of the target.
        config: Settings; not used, but part of every perceiver's constructor.
    """

    images: ImageKind = "bscan"
    entities = ENTITIES["bscan"]
    entities_with_sd = frozenset(("needle_tip", "needle_line"))

    def __init__(self, registration: ScanRegistration, config: PerceptionConfig) -> None:
        self._registration = registration
        image = registration.image
        self._scale = ScanScale(image.mm_per_px, image.axial_mm_per_px or image.mm_per_px)
        self._build_observation = ObservationBuilder(registration)

    def reset(self) -> None:
        """Do nothing: every image is processed independently."""

    def __call__(self, capture: Capture) -> Observation:
        """Process one image.

        Raises:
            BadInput: If it is not a B-scan of the registered size.
        """
        scan = scan_image(grey_of(self._registration.checked(capture.image)), self._scale)
        surfaces = find_surfaces(scan)
        needle, surfaces = find_needle(scan, surfaces, _brightest_beside(scan, surfaces))
        if needle and not surfaces.ilm_visible.any():  # perhaps a ghost was mistaken for all of it
            surfaces = find_surfaces(without_needle(scan, needle))
            needle, surfaces = find_needle(scan, surfaces, _brightest_beside(scan, surfaces))
        return self._build_observation(
            capture.stamp_ns, _layers(scan, surfaces), needle and _shaft(scan, needle)
        )


def _brightest_beside(scan: ScanImage, surfaces: Surfaces) -> float:
    """Return the largest grey value beside a needle; the vitreous may be bright."""
    dark_grey, bright_grey = scan.levels.dark_grey, scan.levels.bright_grey
    shares_grey = DARK_SHARE * surfaces.tissue_grey, BRIGHT_SHARE * (bright_grey - dark_grey)
    return dark_grey + max(DARK_GREY, *shares_grey)


def _layers(scan: ScanImage, surfaces: Surfaces) -> Layers:
    """Return the surfaces in pixels of the scan."""
    if scan.averaged_px == 1:
        return Layers(*surfaces[:7])
    factor, half = scan.averaged_px, (scan.averaged_px - 1) / 2
    return Layers(
        factor * surfaces.x_px + half,
        factor * surfaces.ilm_px + half,
        surfaces.ilm_visible,
        factor * surfaces.rpe_px + half,
        surfaces.rpe_visible,
        factor * surfaces.ilm_sd_px,
        factor * surfaces.rpe_sd_px,
    )


def _shaft(scan: ScanImage, needle: Needle) -> Shaft:
    """Return a needle in pixels of the scan."""
    line = needle.ridge.line
    (x, y), (start_x, start_y) = needle.tip_px, line.start_px
    return Shaft(
        tip_px=(scan.scan_px(x), scan.scan_px(y)),
        start_px=(scan.scan_px(start_x), scan.scan_px(start_y)),
        along_px=line.along_px,
        sd_px=needle.sd_px and (scan.averaged_px * needle.sd_px[0], scan.averaged_px * needle.sd_px[1]),
        angle_sd_deg=float(np.degrees(line.angle_sd_rad)),
        confidence=needle.confidence,
    )
