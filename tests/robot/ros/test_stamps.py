import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.clock import VirtualClock
from haptigraph.robot.ros.stamps import WINDOW, StampClock

UTC_NS = 1_790_000_000_000_000_000
MS = 1_000_000
HOUR = 3_600_000 * MS


def stamps(clock):
    return StampClock(clock, lambda: clock.now_ns() + UTC_NS)


def feed(clock, converter, arrival_ms, stamp_ns):
    clock.wait_until(arrival_ms * MS)
    return converter.to_run_clock(stamp_ns, clock.now_ns())


def test_stamps_of_synchronised_machines_keep_their_latency():
    clock = VirtualClock()
    converter = stamps(clock)
    for time_ms in range(30, 3000, 10):
        assert feed(clock, converter, time_ms, UTC_NS + (time_ms - 30) * MS) == (time_ms - 30) * MS
    assert converter.note == ""


def test_a_stamp_a_little_ahead_is_that_of_arrival():
    clock = VirtualClock()
    converter = stamps(clock)
    assert feed(clock, converter, 100, UTC_NS + 110 * MS) == 100 * MS
    assert converter.note == ""


@pytest.mark.parametrize(("hours", "said"), [(-2, "7200.0 s in the past"), (3, "10800.0 s in the future")])
def test_stamps_of_another_clock_keep_their_jitter_and_are_noted(hours, said):
    clock = VirtualClock()
    converter = stamps(clock)
    found = [
        feed(clock, converter, time_ms + delay_ms, UTC_NS + time_ms * MS + hours * HOUR)
        for time_ms, delay_ms in [(0, 5), (10, 5), (20, 9), (30, 5), (40, 14)]
    ]
    assert found == [5 * MS, 15 * MS, 25 * MS, 35 * MS, 45 * MS]
    assert said in converter.note


def test_without_a_stamp_arrival_counts_and_is_noted():
    clock = VirtualClock()
    converter = stamps(clock)
    assert [feed(clock, converter, time_ms, 0) for time_ms in (10, 20, 30)] == [10 * MS, 20 * MS, 30 * MS]
    assert "no stamp" in converter.note


@pytest.mark.parametrize("hours", [0, -2, 3])
def test_a_frozen_stamp_grows_old(hours):
    """However long it lasts, and whatever clock it is of."""
    clock = VirtualClock()
    converter = stamps(clock)
    stamp_ns = UTC_NS + 10 * MS + hours * HOUR
    first_ns = feed(clock, converter, 20, stamp_ns)
    for time_ms in range(30, 20_000, 10 * WINDOW):
        assert feed(clock, converter, time_ms, stamp_ns) == first_ns <= 20 * MS


def test_a_clock_that_is_slow_grows_old_too():
    clock = VirtualClock()
    converter = stamps(clock)
    ages_ms = [
        time_ms - feed(clock, converter, time_ms, UTC_NS + time_ms * MS // 2) / MS
        for time_ms in range(10, 5000, 10)
    ]
    assert ages_ms == sorted(ages_ms)
    assert ages_ms[-1] > 2000


def test_an_older_stamp_is_refused():
    clock = VirtualClock()
    converter = stamps(clock)
    feed(clock, converter, 20, UTC_NS + 15 * MS)
    with pytest.raises(ValueError, match=r"a stamp 5\.0 ms older than the previous one"):
        feed(clock, converter, 30, UTC_NS + 10 * MS)


@given(
    st.integers(-4 * HOUR, 4 * HOUR),
    st.lists(st.tuples(st.integers(1, 50 * MS), st.integers(0, 80 * MS)), min_size=1, max_size=50),
)
def test_no_measurement_is_later_than_its_arrival(offset_ns, steps):
    clock = VirtualClock(10 * MS)
    converter = stamps(clock)
    time_ns = 0
    for step_ns, delay_ns in steps:
        time_ns += step_ns
        clock.wait_until(time_ns + delay_ns)
        found_ns = converter.to_run_clock(UTC_NS + time_ns + offset_ns, clock.now_ns())
        assert found_ns <= clock.now_ns()
