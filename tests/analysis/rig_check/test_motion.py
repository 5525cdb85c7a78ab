"""The motion since the registration, against known motions, with and without a reference image."""

import numpy as np
import pytest
from msgspec.structs import replace
from rig_pictures import view, with_shaft
from rig_setups import simulated_setup, warped

from haptigraph.analysis.rig_check.motion import by_reference, by_rim, turned_ports
from haptigraph.analysis.rig_check.position import residuals

SEED = 9102


@pytest.fixture(scope="module")
def sound():
    return simulated_setup(0, SEED, has_mark=False, has_reference=True)


@pytest.mark.parametrize(
    ("zoom", "turn_deg", "shift_px"),
    [
        (1.0, 0.0, (0.0, 0.0)),
        (0.98, 3.0, (-8.0, 2.0)),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in ((1.03, 0.0, (4.0, -3.0)), (1.0, -7.0, (0.0, 12.0)))
        ),
    ],
)
def test_a_known_motion_is_recovered_within_its_uncertainty(sound, zoom, turn_deg, shift_px):
    motion = by_reference(view(warped(sound, zoom=zoom, turn_deg=turn_deg, shift_px=shift_px)))
    assert motion is not None
    assert motion.turn_deg is not None
    assert motion.shift_sd_px < 0.3
    assert motion.shift_px == pytest.approx(np.hypot(*shift_px), abs=0.3)
    assert motion.turn_deg == pytest.approx(turn_deg, abs=0.2)
    assert motion.scale == pytest.approx(zoom, abs=0.003)


def test_without_a_reference_image_the_rim_shows_the_shift():
    sound = simulated_setup(1, SEED, has_reference=False)
    still, moved = (by_rim(view(warped(sound, shift_px=shift))) for shift in ((0.0, 0.0), (6.0, 0.0)))
    assert by_reference(view(sound)) is None
    assert still is not None
    assert moved is not None
    assert still.shift_px < 1.5
    assert moved.shift_px == pytest.approx(6.0, abs=1.5)


def with_shade(setup):
    """Let the lower rim fade into the bowl, so that a shade within the bowl has the steeper edge."""
    (x, y), radius_px = setup.registration.image.center_px, 12.0 * setup.px_per_mm
    height, width = setup.images[0].shape[:2]
    rows, columns = np.mgrid[:height, :width]
    away, is_low = np.hypot(columns - x, rows - y) / radius_px, rows - y > 0.6 * np.abs(columns - x)
    wall, bowl = (np.median(setup.images[0][is_low & (abs(away - at) < 0.02)], axis=0) for at in (1.06, 0.9))
    ramp = (
        np.clip((away - 0.955) / 0.012, 0, 1)[..., None] * 0.5
        + np.clip((away - 0.967) / 0.06, 0, 1)[..., None] * 0.5
    )
    shade = bowl + ramp * (wall - bowl)
    inside = is_low & (away < 1.03) & (away > 0.94)
    images = tuple(np.where(inside[..., None], shade, image).astype(np.uint8) for image in setup.images[:9])
    return replace(setup, images=images)


def test_a_shade_beside_the_rim_does_not_hide_a_motion():
    shaded = with_shade(simulated_setup(1, SEED, has_mark=False, has_reference=False))
    still, moved = (by_rim(view(warped(shaded, shift_px=shift))) for shift in ((0.0, 0.0), (0.0, 4.0)))
    assert still is not None
    assert moved is not None
    assert abs(still.shift_px) < 1.5
    assert moved.shift_sd_px < 0.5
    assert moved.shift_px == pytest.approx(4.0, abs=1.5)


@pytest.mark.parametrize("turn_deg", [-25.0, 25.0])
def test_a_port_opening_behind_a_shaft_is_less_certain(turn_deg):
    sound = simulated_setup(4, SEED, has_mark=False, has_reference=False)
    occluded = view(with_shaft(sound, turn_deg, 40))
    used, other = turned_ports(occluded)
    assert used.sd_deg > other.sd_deg
    assert abs(used.turn_deg) < 2 * used.sd_deg
    assert residuals(occluded).findings == ()
