from hypothesis import given
from hypothesis import strategies as st

from haptigraph.clock import Cycles, MonotonicClock, VirtualClock


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


@given(st.lists(st.integers(0, 50)))
def test_cycles_keep_to_their_period_and_leave_out_those_that_are_missed(works):
    clock = VirtualClock(1000)
    cycles, begun = Cycles(clock, 10), []
    for work_ns in works:
        now_ns, late_ns = cycles.wait()
        assert now_ns == clock.now_ns()
        begun.append(now_ns - late_ns)
        clock.wait_until(now_ns + work_ns)
    assert all(due_ns % 10 == 0 for due_ns in begun)
    assert begun == sorted(set(begun))
    now_ns, _ = cycles.wait()
    assert len(works) + cycles.missed == (now_ns - 1000) // 10
