from hypothesis import given
from hypothesis import strategies as st

from haptigraph.clock import MonotonicClock, VirtualClock


@given(st.lists(st.integers(0, 10**12)))
def test_a_virtual_clock_jumps_forward_and_never_back(waits):
    clock = VirtualClock()
    for stamp_ns in waits:
        before_ns = clock.now_ns()
        clock.wait_until(stamp_ns)
        assert clock.now_ns() == max(before_ns, stamp_ns)


def test_the_monotonic_clock_never_returns_early():
    clock = MonotonicClock()
    due_ns = clock.now_ns() + 2_000_000
    clock.wait_until(due_ns)
    assert clock.now_ns() >= due_ns
    clock.wait_until(0)  # in the past: returns at once
