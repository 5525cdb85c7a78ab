import numpy as np
import pytest
from drawn_strip import LANES, strip

from haptigraph.perception.needle.coarse_tip import estimate_coarse_tip
from haptigraph.perception.needle.rectify import STATION_PX


@pytest.mark.parametrize(("gap", "where"), [(0, "inside"), (2, "outside")])
def test_a_needle_that_ends_before_known_background_does_not_enter_the_wall(gap, where):
    u_px = np.arange(-240, 100, STATION_PX, dtype=np.float32)
    shown = strip(np.zeros((len(LANES), len(u_px))), u_px)
    end, rim = shown.outside.stop - gap, shown.inside.start
    for part in (slice(0, end), slice(rim, rim + 2)):  # at the rim it looks like a tip when the light changes
        shown.excess[:, part] += 30.0 * (abs(LANES) <= 4)
    tip = estimate_coarse_tip(shown, px_per_mm=20.0, usual_grey=None)
    assert tip is not None
    assert tip.where == where


@pytest.mark.parametrize(("length_px", "where"), [(8, "occluded"), (30, "inside")])
def test_a_needle_beyond_a_cannula_that_was_always_there_is_inside(length_px, where):
    u_px = np.arange(-240, 200, STATION_PX, dtype=np.float32)
    shown = strip(np.zeros((len(LANES), len(u_px))), u_px)
    cannula = shown.inside.start + round(40 / STATION_PX)
    for part in (slice(0, shown.outside.stop), slice(cannula, cannula + round(length_px / STATION_PX))):
        shown.excess[:, part] += 30.0 * (abs(LANES) <= 4)
    tip = estimate_coarse_tip(shown, px_per_mm=20.0, usual_grey=None)
    assert tip is not None
    assert tip.where == where
