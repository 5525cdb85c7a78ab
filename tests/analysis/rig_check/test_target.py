"""What is taken for the mark of the target."""

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from rig_pictures import view
from rig_setups import simulated_setup

from haptigraph.analysis.rig_check.target import found_mark, target

SEED = 9104
AT_DEG, HALF_MM = 30.0, 0.8


@pytest.fixture(scope="module")
def sound():
    return simulated_setup(0, SEED, has_mark=False, has_reference=False)


def painted(setup, off_mm, gain, half_mm=HALF_MM):
    """Multiply the brightness of a spot, so far outside the rim, by a gain for each colour."""
    (x, y), scale = setup.registration.image.center_px, setup.px_per_mm
    reach_px, angle = (setup.registration.globe.radius_mm + off_mm) * scale, np.radians(AT_DEG)
    height, width = setup.images[0].shape[:2]
    rows, columns = np.mgrid[:height, :width]
    away = np.hypot(columns - x - reach_px * np.sin(angle), rows - y - reach_px * np.cos(angle))
    cover = cv2.GaussianBlur((away < half_mm * scale).astype(np.float32), (0, 0), 1.0)[..., None]
    images = (image * (1 + cover * (np.array(gain) - 1)) for image in setup.images[:9])
    return replace(setup, images=tuple(np.clip(each, 0, 255).astype(np.uint8) for each in images))


def test_a_painted_spot_is_the_mark(sound):
    mark = found_mark(view(painted(sound, 0.6, (0.5, 0.5, 0.9))))
    assert mark is not None
    assert mark.angle_deg == pytest.approx(AT_DEG, abs=2 * mark.sd_deg)


@pytest.mark.parametrize("gain", [0.93, 0.95])
def test_uneven_light_on_the_cut_face_is_no_mark(sound, gain):
    shaded = view(painted(sound, 0.6, (gain, gain, gain)))
    assert found_mark(shaded) is None
    assert target(shaded, sound.rig).findings == ()


def test_a_specular_highlight_on_the_retina_is_no_mark(sound):
    assert found_mark(view(painted(sound, -0.5, (9.0, 9.0, 9.0), 0.35))) is None
