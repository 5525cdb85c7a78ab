import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.messages import CameraStamp
from haptigraph.sources.cameras.timebase import JUMP_NS, Timebase

MS = 1_000_000
PERIOD_NS = 33_333_333


def arrivals(delays_ms, *, drift_ppm=0.0, zero_ns=0):
    """Images taken at a steady rate, stamped by a clock of the camera's own, that arrive late by so much."""
    arrived_ns = -1
    for number, delay_ms in enumerate(delays_ms):
        taken_ns = number * PERIOD_NS
        stamp_ns = zero_ns + round(taken_ns * (1 + drift_ppm / 1e6))
        arrived_ns = max(taken_ns + round(delay_ms * MS), arrived_ns + 1)  # none overtakes another
        yield taken_ns, CameraStamp("hardware", stamp_ns, arrived_ns)


delays = st.lists(st.floats(20, 70), min_size=1, max_size=400)


@given(delays, st.floats(-50, 50), st.integers(-(10**18), 10**18))
def test_stamps_rise_and_no_image_is_stamped_after_it_arrived(delays_ms, drift_ppm, zero_ns):
    timebase, last_ns = Timebase(), None
    for _, camera in arrivals(delays_ms, drift_ppm=drift_ppm, zero_ns=zero_ns):
        stamp_ns = timebase.on_run(camera)
        assert last_ns is None or stamp_ns > last_ns
        assert stamp_ns <= camera.arrived_ns
        last_ns = stamp_ns


@given(st.lists(st.floats(20, 70), max_size=299), st.floats(-50, 50), st.integers(-(10**18), 10**18))
def test_jitter_is_gone_once_one_image_came_straight(delays_ms, drift_ppm, zero_ns):
    """What is left is the way every image goes (20 ms here), and the drift while it is remembered."""
    timebase = Timebase()
    for taken_ns, camera in arrivals([20.0, *delays_ms], drift_ppm=drift_ppm, zero_ns=zero_ns):
        off_ns = timebase.on_run(camera) - taken_ns - 20 * MS
        assert abs(off_ns) < 0.6 * MS


def test_ten_minutes_of_drift_does_not_add_up():
    timebase = Timebase()
    jitter_ms = [20.0 + 30.0 * (number % 7 != 0) for number in range(18_000)]
    off_ns = [timebase.on_run(camera) - taken_ns for taken_ns, camera in arrivals(jitter_ms, drift_ppm=50)]
    assert max(abs(off - 20 * MS) for off in off_ns) < 0.6 * MS


@pytest.mark.parametrize("jump_ns", [-3600 * 10**9, -2 * JUMP_NS, 2 * JUMP_NS, 3600 * 10**9])
def test_a_clock_that_is_set_is_followed_at_the_next_image(jump_ns):
    timebase = Timebase()
    for number in range(50):
        arrived_ns = number * PERIOD_NS
        stamp_ns = timebase.on_run(CameraStamp("global", arrived_ns - 30 * MS, arrived_ns))
        assert stamp_ns == arrived_ns
    for number in range(50, 100):
        arrived_ns = number * PERIOD_NS
        stamp_ns = timebase.on_run(CameraStamp("global", arrived_ns - 30 * MS + jump_ns, arrived_ns))
        assert stamp_ns == arrived_ns


def test_another_clock_begins_anew():
    timebase = Timebase()
    timebase.on_run(CameraStamp("hardware", 10**9, 5 * 10**9))
    assert timebase.on_run(CameraStamp("global", 10**18, 5 * 10**9 + PERIOD_NS)) == 5 * 10**9 + PERIOD_NS


def test_a_stamp_without_arrival_is_refused():
    with pytest.raises(ValueError, match="without arrival"):
        Timebase().on_run(CameraStamp("global", 0))
