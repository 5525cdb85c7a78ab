"""The perceiver of B-scans: two surfaces of the retina and a needle, anew in every image.

Turns an image (px) into where things are (eye frame, mm), by best paths, ridges and where the shadow begins.
Knows nothing of states, and no image before.
"""

import numpy as np

from haptigraph.config import PerceptionConfig
from haptigraph.imaging import grey_of
from haptigraph.messages import Capture, Observation
from haptigraph.perception.oct.needle import find_needle, lines_of, off_ridges
from haptigraph.perception.oct.ridge import find_ridges
from haptigraph.perception.oct.scan_geometry import ENTITIES, Layers, ScanPlaces, Shaft
from haptigraph.perception.oct.surfaces import find_surfaces
from haptigraph.registration.oct import ScanRegistration

__all__ = ["BscanPerceiver"]

DARK_GREY, DARK_SHARE = 40.0, 0.75  # beside a needle it is no brighter; of tissue


class BscanPerceiver:
    """Find ILM, RPE and needle.

    Args:
        registration: Size and scale of the B-scans, and how deep the target lies.
        config: Settings; none is needed so far, but all perceivers are given them.
    """

    needs_scan = True
    entities = ENTITIES

    def __init__(self, registration: ScanRegistration, config: PerceptionConfig) -> None:
        self._registration = registration
        self._axial_mm = registration.image.axial_mm_per_px or registration.image.mm_per_px
        self._places = ScanPlaces(registration)

    def reset(self) -> None:
        """Forget earlier images: there is nothing to forget."""

    def __call__(self, capture: Capture) -> Observation:
        """Appearance at one image.

        Raises:
            BadInput: If it is no B-scan of the registered size.
        """
        image = grey_of(self._registration.checked(capture.image))
        height, width = image.shape
        surfaces = find_surfaces(image, self._axial_mm)
        ilm_px = np.interp(
            np.arange(width), surfaces.x_px, np.where(surfaces.ilm_seen, surfaces.ilm_px, height)
        )
        dark_grey = surfaces.dark_grey + max(DARK_GREY, DARK_SHARE * surfaces.tissue_grey)
        ridges = find_ridges(image, ilm_px, dark_grey, surfaces.sd_grey)
        lines = lines_of(ridges, surfaces)
        surfaces = off_ridges(surfaces, lines)
        needle = find_needle(image, lines, surfaces)
        shaft = needle and Shaft(
            tip_px=needle.tip_px,
            start_px=needle.ridge.start_px,
            along_px=needle.ridge.along_px,
            sd_px=needle.sd_px,
            angle_sd_deg=needle.ridge.angle_sd_deg,
            confidence=needle.confidence,
        )
        return self._places(capture.stamp_ns, Layers(*surfaces[:5]), shaft)
