"""Pictures of a rig with an instrument drawn into them, and what a check of a rig looks at."""

import cv2
import numpy as np
from msgspec.structs import replace
from rig_setups import Setup

from haptigraph.analysis.rig_check.clip import clip_of
from haptigraph.analysis.rig_check.view import View, view_of
from haptigraph.messages import Capture

IMAGES = 9


def view(setup: Setup) -> View:
    """Return the view of a few images of a rig."""
    images = setup.images[:IMAGES]
    captures = [Capture(number, number * 33_000_000, image) for number, image in enumerate(images)]
    return view_of(clip_of(captures, setup.registration, 30.0), setup.registration)


def with_shaft(setup: Setup, turn_deg: float, grey: int, length_mm: float = 8.0) -> Setup:
    """Draw a shaft of 0.9 mm through the port in use, turned from the radius."""
    registration = setup.registration
    trocar_mm, turn = np.array(registration.trocar.at_mm), np.radians(turn_deg)
    inwards = -trocar_mm / np.linalg.norm(trocar_mm)
    along = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ inwards
    ends = [registration.image.to_px(tuple(trocar_mm + at_mm * along)) for at_mm in (-5.0, length_mm)]
    first, last = (tuple(np.rint(np.array(end) * 16).astype(int).tolist()) for end in ends)
    width_px = round(0.9 * setup.px_per_mm)
    images = (
        cv2.line(image.copy(), first, last, (grey,) * 3, width_px, cv2.LINE_AA, 4)
        for image in setup.images[:IMAGES]
    )
    return replace(setup, images=tuple(np.asarray(image, np.uint8) for image in images))
