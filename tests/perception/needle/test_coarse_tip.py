import numpy as np
import pytest
from drawn_strip import LANES, strip

from haptigraph.perception.needle.coarse_tip import estimate_coarse_tip
from haptigraph.perception.needle.rectify import STATION_PX


@pytest.mark.parametrize(("gap", "where"), [(0, "inside"), (2, "outside")])
def test_a_needle_before_known_ground_that_shows_nothing_does_not_enter_the_wall(gap, where):
    u_px = np.arange(-240, 100, STATION_PX, dtype=np.float32)
    seen = strip(np.zeros((len(LANES), len(u_px))), u_px)
    end, rim = seen.before.stop - gap, seen.inside.start
    for part in (slice(0, end), slice(rim, rim + 2)):  # at the rim it looks like a tip when the light changes
        seen.excess[:, part] += 30.0 * (abs(LANES) <= 4)
    reach = estimate_coarse_tip(seen, px_per_mm=20.0, usual_grey=None)
    assert reach is not None
    assert reach.where == where
