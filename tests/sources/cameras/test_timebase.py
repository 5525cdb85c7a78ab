import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.messages import CameraStamp
from haptigraph.sources.cameras.timebase import MAX_DELAY_NS, Timebase

MS = 1_000_000
PERIOD_NS = 33_333_333


def arrivals(delays_ms, *, drift_ppm=0.0, zero_ns=0):
    """Images taken at a constant rate, stamped by the camera's clock, that arrive with these delays."""
    arrived_ns = -1
    for number, delay_ms in enumerate(delays_ms):
        taken_ns = number * PERIOD_NS
        stamp_ns = zero_ns + round(taken_ns * (1 + drift_ppm / 1e6))
        arrived_ns = max(taken_ns + round(delay_ms * MS), arrived_ns + 1)  # in order
        yield taken_ns, CameraStamp("hardware", stamp_ns, arrived_ns)


delays = st.lists(st.floats(20, 70), min_size=1, max_size=400)


@given(delays, st.floats(-50, 50), st.integers(-(10**18), 10**18))
def test_stamps_increase_and_never_exceed_the_arrival(delays_ms, drift_ppm, zero_ns):
    timebase, last_ns = Timebase(), None
    for _, camera in arrivals(delays_ms, drift_ppm=drift_ppm, zero_ns=zero_ns):
        stamp_ns = timebase.to_run_clock(camera)
        assert last_ns is None or stamp_ns > last_ns
        assert stamp_ns <= camera.arrived_ns
        last_ns = stamp_ns


@given(st.lists(st.floats(20, 70), max_size=299), st.floats(-50, 50), st.integers(-(10**18), 10**18))
def test_jitter_is_removed_after_one_image_with_minimum_delay(delays_ms, drift_ppm, zero_ns):
    """The constant latency (20 ms here) remains, and the drift within the window."""
    timebase = Timebase()
    for taken_ns, camera in arrivals([20.0, *delays_ms], drift_ppm=drift_ppm, zero_ns=zero_ns):
        error_ns = timebase.to_run_clock(camera) - taken_ns - 20 * MS
        assert abs(error_ns) < 0.6 * MS


def test_drift_does_not_accumulate_over_ten_minutes():
    timebase = Timebase()
    jitter_ms = [20.0 + 30.0 * (number % 7 != 0) for number in range(18_000)]
    images = arrivals(jitter_ms, drift_ppm=50)
    latencies_ns = [timebase.to_run_clock(camera) - taken_ns for taken_ns, camera in images]
    assert max(abs(latency_ns - 20 * MS) for latency_ns in latencies_ns) < 0.6 * MS


@pytest.mark.parametrize("jump_ns", [-3600 * 10**9, -2 * MAX_DELAY_NS, 2 * MAX_DELAY_NS, 3600 * 10**9])
def test_after_a_clock_is_set_the_next_image_has_the_new_offset(jump_ns):
    timebase = Timebase()
    for number in range(50):
        arrived_ns = number * PERIOD_NS
        stamp_ns = timebase.to_run_clock(CameraStamp("global", arrived_ns - 30 * MS, arrived_ns))
        assert stamp_ns == arrived_ns
    for number in range(50, 100):
        arrived_ns = number * PERIOD_NS
        stamp_ns = timebase.to_run_clock(CameraStamp("global", arrived_ns - 30 * MS + jump_ns, arrived_ns))
        assert stamp_ns == arrived_ns


def test_another_clock_resets_the_offset():
    timebase = Timebase()
    timebase.to_run_clock(CameraStamp("hardware", 10**9, 5 * 10**9))
    assert (
        timebase.to_run_clock(CameraStamp("global", 10**18, 5 * 10**9 + PERIOD_NS)) == 5 * 10**9 + PERIOD_NS
    )


def test_a_stamp_without_arrival_is_rejected():
    with pytest.raises(ValueError, match="without arrival"):
        Timebase().to_run_clock(CameraStamp("global", 0))
