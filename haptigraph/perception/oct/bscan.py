"""The perceiver `bscan`: ILM, RPE and needle in a B-scan, by image processing.

Turns an image (px) into positions (eye frame, mm), by shortest paths, ridges and the edge of the needle's
shadow. Every image is processed independently.
"""

import numpy as np

from haptigraph.config import PerceptionConfig
from haptigraph.imaging import grey_of
from haptigraph.messages import Capture, ImageKind, Observation
from haptigraph.perception.entities import ENTITIES
from haptigraph.perception.oct.needle import find_needle, needle_candidates, without_ridge_columns
from haptigraph.perception.oct.ridge import find_ridges
from haptigraph.perception.oct.scan_geometry import Layers, ObservationBuilder, Shaft
from haptigraph.perception.oct.surfaces import find_surfaces
from haptigraph.registration.oct import ScanRegistration

__all__ = ["BscanPerceiver"]

DARK_GREY, DARK_SHARE = 40.0, 0.75  # brightness limit beside a needle: absolute, and as a share of tissue


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
        self._axial_mm = registration.image.axial_mm_per_px or registration.image.mm_per_px
        self._build_observation = ObservationBuilder(registration)

    def reset(self) -> None:
        """Do nothing: every image is processed independently."""

    def __call__(self, capture: Capture) -> Observation:
        """Process one image.

        Raises:
            BadInput: If it is not a B-scan of the registered size.
        """
        image = grey_of(self._registration.checked(capture.image))
        height, width = image.shape
        surfaces = find_surfaces(image, self._axial_mm)
        ilm_px = np.interp(
            np.arange(width), surfaces.x_px, np.where(surfaces.ilm_visible, surfaces.ilm_px, height)
        )
        dark_grey = surfaces.dark_grey + max(DARK_GREY, DARK_SHARE * surfaces.tissue_grey)
        ridges = find_ridges(image, ilm_px, dark_grey, surfaces.sd_grey)
        candidates = needle_candidates(ridges, surfaces)
        surfaces = without_ridge_columns(surfaces, candidates)
        needle = find_needle(image, candidates, surfaces)
        shaft = needle and Shaft(
            tip_px=needle.tip_px,
            start_px=needle.ridge.start_px,
            along_px=needle.ridge.along_px,
            sd_px=needle.sd_px,
            angle_sd_deg=needle.ridge.angle_sd_deg,
            confidence=needle.confidence,
        )
        return self._build_observation(capture.stamp_ns, Layers(*surfaces[:5]), shaft)
