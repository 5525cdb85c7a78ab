import math
from itertools import pairwise

import pytest
from helpers import LOW, MS, PULSE, SUCCESS, make_step
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.config import HapticsConfig
from haptigraph.errors import DeviceError
from haptigraph.haptics.guard import Guard
from haptigraph.messages import OFF, UNKNOWN, Capabilities, Fault, Pattern


class Spy:
    """A device that logs its commands, and raises `error` if it is set."""

    capabilities = Capabilities(100, None, 0.0)

    def __init__(self, capabilities=None):
        self.capabilities = capabilities or Spy.capabilities
        self.log: list[tuple[float, float, float]] = []
        self.error: Exception | None = None
        self.attempts_ms: list[float] = []
        self.closed = 0

    def set(self, amplitude, frequency_hz, stamp_ns):
        self.attempts_ms.append(stamp_ns / MS)
        if self.error is not None:
            raise self.error
        self.log.append((stamp_ns / MS, amplitude, frequency_hz))

    def close(self):
        self.closed += 1

    @property
    def amplitude(self) -> float:
        return self.log[-1][1] if self.log else 0.0

    def edges(self):
        """The logged amplitudes without the silence with which every guard begins."""
        assert self.log[0][1] == 0.0
        return [(ms, amplitude) for ms, amplitude, _ in self.log[1:]]


@pytest.fixture
def spy():
    return Spy()


def guard_of(spy, **settings) -> Guard:
    return Guard(spy, HapticsConfig(**settings))


def send(guard, pattern, ms, *, since_ms=None, state="some_state"):
    since_ns = None if since_ms is None else round(since_ms * MS)
    guard.send(make_step(pattern, stamp_ns=round(ms * MS), since_ns=since_ns, state=state), round(ms * MS))


def test_pulses_reach_the_device_edge_by_edge_on_time(spy):
    guard = guard_of(spy)
    for ms in range(0, 400, 33):
        send(guard, PULSE, ms, since_ms=0)
    assert spy.edges() == [(0, 1.0), (80, 0.0), (160, 1.0), (240, 0.0), (320, 1.0)]
    assert {frequency for _, amplitude, frequency in spy.log if amplitude} == {160}


def test_a_steady_vibration_is_sent_once(spy):
    guard = guard_of(spy)
    for ms in range(0, 500, 33):
        send(guard, LOW, ms, since_ms=0)
    assert spy.edges() == [(0, 0.3)]


def test_the_actuator_is_silenced_when_no_command_arrives_for_deadman_ms(spy):
    guard = guard_of(spy, deadman_ms=150)
    send(guard, LOW, 100)
    guard.advance(1000 * MS)
    assert spy.edges() == [(100, 0.3), (250, 0.0)]


def test_a_new_command_ends_the_silence(spy):
    guard = guard_of(spy)
    send(guard, LOW, 0)
    guard.advance(500 * MS)
    send(guard, LOW, 600, since_ms=0)
    assert spy.edges()[-1] == (600, 0.3)


def test_unknown_is_silent_whatever_is_commanded(spy):
    guard = guard_of(spy)
    send(guard, LOW, 0)
    send(guard, PULSE, 33, state=UNKNOWN)
    assert spy.amplitude == 0
    guard.advance(2000 * MS)
    assert spy.amplitude == 0


def test_amplitude_is_limited(spy):
    guard = guard_of(spy, max_amplitude=0.5)
    send(guard, PULSE, 0)
    assert spy.amplitude == 0.5


def test_a_long_vibration_is_paused(spy):
    guard = guard_of(spy, max_on_ms=1000, rest_ms=200)
    for ms in range(0, 1500, 30):
        send(guard, LOW, ms, since_ms=0)
    assert spy.edges() == [(0, 0.3), (1000, 0.0), (1200, 0.3)]
    (fault,) = guard.take_faults()
    assert fault.where == "guard"
    assert fault.message == "vibration paused for 0.2 s: it lasted 1 s"


def test_pulses_are_never_paused(spy):
    guard = guard_of(spy, max_on_ms=500)
    for ms in range(0, 3000, 30):
        send(guard, PULSE, ms, since_ms=0)
    assert guard.take_faults() == ()


def test_a_late_command_does_not_shorten_a_burst(spy):
    guard = guard_of(spy)
    latency_ns = 60 * MS  # from image to guard
    for ms in range(0, 400, 20):
        step = make_step(SUCCESS, stamp_ns=ms * MS, since_ns=0)
        guard.send(step, ms * MS + latency_ns)
    assert spy.edges() == [(60, 0.8), (160, 0.0), (260, 0.8), (360, 0.0)]


def test_after_silence_nothing_is_played_or_due_until_the_next_step(spy):
    guard = guard_of(spy, deadman_ms=1000, max_on_ms=500)
    send(guard, LOW, 0)
    guard.silence()
    assert guard.next_edge_ns() is None  # the on-time has ended with the vibration
    guard.advance(100 * MS)
    assert spy.edges() == [(0, 0.3), (0, 0.0)]
    send(guard, LOW, 400)
    guard.advance(899 * MS)
    assert spy.amplitude == 0.3
    guard.advance(900 * MS)
    assert spy.amplitude == 0.0


def test_close_silences_for_good(spy):
    guard = guard_of(spy)
    send(guard, LOW, 0)
    guard.close()
    guard.close()
    assert (spy.amplitude, spy.closed) == (0.0, 1)
    assert guard.is_silent


@pytest.mark.parametrize("error", [DeviceError("unplugged"), OSError("gone"), RuntimeError("firmware")])
def test_a_failing_device_is_reported_once_and_retried(spy, error):
    guard = guard_of(spy)
    spy.error = error
    for ms in range(0, 3000, 33):
        send(guard, LOW, ms, since_ms=0)
    (fault,) = guard.take_faults()
    assert (fault.where, fault.message) == ("device", str(error))
    spy.error = None
    for ms in range(3000, 4200, 33):
        send(guard, LOW, ms, since_ms=0)
    assert spy.amplitude == 0.3
    assert guard.take_faults() == (Fault("device", "responds again", is_over=True),)


def test_a_device_that_recovers_while_silent_is_silenced(spy):
    guard = guard_of(spy)
    send(guard, LOW, 0)
    spy.error = DeviceError("unplugged")
    guard.advance(500 * MS)
    assert spy.amplitude == 0.3
    spy.error = None
    guard.advance(560 * MS)
    assert spy.edges()[-1][1] == 0.0


def test_a_device_that_cannot_close_does_not_raise(spy):
    guard = guard_of(spy)

    def refuse():
        raise OSError("busy")

    spy.close = refuse
    guard.close()
    assert guard.take_faults()[0].message == "did not close: busy"
    assert guard.is_silent  # because it was set to silence


def test_a_device_that_neither_accepts_silence_nor_closes_may_still_vibrate(spy):
    guard = guard_of(spy)
    send(guard, LOW, 0)
    spy.error = DeviceError("hung")

    def refuse():
        raise DeviceError("does not confirm silence")

    spy.close = refuse
    guard.close()
    assert not guard.is_silent
    assert [fault.message for fault in guard.take_faults()] == [
        "hung",
        "did not close: does not confirm silence",
    ]


patterns = st.one_of(
    st.sampled_from([OFF, LOW, PULSE, SUCCESS]),
    st.builds(
        Pattern,
        name=st.just("any"),
        kind=st.sampled_from(["continuous", "pulses", "bursts"]),
        amplitude=st.floats(0.01, 1),
        on_ms=st.floats(1, 500),
        off_ms=st.floats(1, 500),
        count=st.integers(1, 9),
    ),
)
sends = st.tuples(st.just("send"), st.floats(0, 400), patterns, st.sampled_from(["a", "b", UNKNOWN]))
waits = st.tuples(st.just("wait"), st.floats(0, 400))
failures = st.tuples(st.just("fail"), st.booleans())


@given(
    st.lists(st.one_of(sends, waits, failures), max_size=40),
    st.floats(10, 300),
    st.floats(0, 1),
    st.floats(20, 500),
)
def test_after_any_history_the_actuator_is_silent_within_deadman_ms(history, deadman_ms, limit, max_on_ms):
    spy = Spy()
    guard = guard_of(spy, deadman_ms=deadman_ms, max_amplitude=limit, max_on_ms=max_on_ms, rest_ms=50)
    now_ms, last_send_ms = 0.0, 0.0
    for event in history:
        if event[0] == "fail":
            spy.error = DeviceError("broken") if event[1] else None
            continue
        now_ms += event[1]
        if event[0] == "send":
            send(guard, event[2], now_ms, state=event[3])
            last_send_ms = now_ms
        else:
            guard.advance(round(now_ms * MS))
    spy.error = None
    retried_ms = max(now_ms, last_send_ms + deadman_ms) + 60  # a failed device is retried within this time
    guard.advance(round(retried_ms * MS))
    silent_from_ms = last_send_ms + deadman_ms
    for ms, amplitude, _ in spy.log:
        assert amplitude <= limit
        if ms >= silent_from_ms + 1e-3:
            assert amplitude == 0
    assert spy.amplitude == 0


@given(st.lists(st.tuples(st.floats(1, 60), patterns), min_size=1, max_size=40), st.floats(20, 200))
def test_no_vibration_lasts_longer_than_max_on_ms(history, max_on_ms):
    spy = Spy()
    guard = guard_of(spy, max_on_ms=max_on_ms, rest_ms=50)
    now_ms = 0.0
    for wait_ms, pattern in history:
        now_ms += wait_ms
        send(guard, pattern, now_ms)
    guard.advance(round((now_ms + 1000) * MS))
    on_since = None
    for ms, amplitude, _ in spy.log:
        if amplitude and on_since is None:
            on_since = ms
        if not amplitude and on_since is not None:
            assert ms - on_since <= max_on_ms + 1e-3
            on_since = None
    assert on_since is None


@pytest.mark.parametrize("key", ["amplitude", "frequency_hz", "on_ms", "off_ms"])
@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, -1.0, 1e305])
def test_invalid_numbers_cause_silence_and_a_fault(spy, key, number):
    guard = guard_of(spy)
    send(guard, PULSE, 0)
    send(guard, replace(PULSE, **{key: number}), 10)
    guard.advance(100 * MS)
    assert spy.edges() == [(0, 1.0), (10, 0.0)]
    (fault,) = guard.take_faults()
    assert fault.where == "guard"
    assert "pattern 'pulse' has a number below 0 or not finite; output silenced" in fault.message
    send(guard, LOW, 110)
    assert spy.amplitude == 0.3


def on_device(max_rate_hz=None, holds_ms=None, shortest_on_ms=0.0, **settings):
    spy = Spy(Capabilities(100, None, shortest_on_ms, max_rate_hz, holds_ms))
    return spy, guard_of(spy, **settings)


def test_a_change_waits_until_the_device_accepts_it():
    spy, guard = on_device(max_rate_hz=20)
    send(guard, LOW, 0)
    send(guard, replace(LOW, amplitude=0.6), 60)
    send(guard, PULSE, 70)
    guard.advance(200 * MS)
    assert spy.edges() == [
        (50, 0.3),
        (100, 1.0),
        (150, 0.0),
    ]  # the pulse from 70 to 150 begins late and ends on time


def test_silence_never_waits():
    spy, guard = on_device(max_rate_hz=20)
    guard.advance(0)
    send(guard, LOW, 100)
    send(guard, LOW, 101, state=UNKNOWN)
    assert spy.edges() == [(100, 0.3), (101, 0.0)]
    send(guard, LOW, 102)
    guard.advance(200 * MS)
    assert spy.edges() == [(100, 0.3), (101, 0.0), (151, 0.3)]


def test_a_short_pulse_is_extended_to_the_shortest_that_the_device_can_play():
    spy, guard = on_device(shortest_on_ms=50)
    send(guard, replace(PULSE, on_ms=20, off_ms=80), 0)
    guard.advance(149 * MS)
    assert spy.edges() == [(0, 1.0), (50, 0.0), (100, 1.0)]


def test_vibration_of_a_device_that_falls_silent_by_itself_is_renewed_and_silence_is_not():
    spy, guard = on_device(holds_ms=100)
    send(guard, LOW, 0)
    guard.advance(400 * MS)
    assert spy.edges() == [(0, 0.3), (50, 0.3), (100, 0.3), (150, 0.0)]


@given(
    history=st.lists(
        st.tuples(
            st.integers(0, 200),
            st.sampled_from([OFF, LOW, PULSE, SUCCESS, replace(PULSE, on_ms=10, off_ms=10)]),
            st.booleans(),
        ),
        max_size=20,
    ),
    rate_hz=st.sampled_from([None, 5.0, 20.0]),
    holds_ms=st.sampled_from([None, 60.0, 150.0]),
)
def test_silence_and_renewals_are_in_time_and_changes_keep_their_minimum_interval(history, rate_hz, holds_ms):
    spy, guard = on_device(rate_hz, holds_ms)
    now_ms = 0
    for wait_ms, pattern, is_known in history:
        now_ms += wait_ms
        send(guard, pattern, now_ms, state="some_state" if is_known else UNKNOWN)
        if not is_known:
            assert spy.amplitude == 0
    guard.advance((now_ms + 150) * MS)
    assert spy.amplitude == 0
    for (before_ms, *_), (after_ms, amplitude, _) in pairwise(spy.log):
        if amplitude and rate_hz:
            assert after_ms - before_ms >= 1000 / rate_hz - 1e-6
    if holds_ms and (not rate_hz or 1000 / rate_hz <= holds_ms):
        for (before_ms, amplitude, _), (after_ms, *_) in pairwise(spy.log):
            assert not amplitude or after_ms - before_ms <= holds_ms


def test_silence_has_no_frequency(spy):
    guard = guard_of(spy)
    send(guard, PULSE, 0)
    guard.advance(100 * MS)
    assert [frequency for _, amplitude, frequency in spy.log if not amplitude] == [0.0, 0.0]


def test_the_first_command_may_be_silence_that_began_earlier(spy):
    guard = guard_of(spy)
    send(guard, OFF, 100, since_ms=0)
    guard.advance(200 * MS)
    assert spy.amplitude == 0


def test_a_pattern_whose_first_command_was_dropped_starts_on_arrival(spy):
    guard = guard_of(spy)
    send(guard, LOW, 0)
    guard.send(make_step(PULSE, stamp_ns=50 * MS, since_ns=30 * MS), 60 * MS)
    guard.advance(139 * MS)
    assert spy.amplitude == 1.0
    guard.advance(140 * MS)
    assert spy.amplitude == 0.0


def test_the_next_edge_of_a_late_pattern_is_late_by_the_same_time(spy):
    guard = guard_of(spy)
    guard.send(make_step(PULSE, stamp_ns=0, since_ns=0), 60 * MS)
    assert guard.next_edge_ns() == 140 * MS


def test_after_the_deadman_timer_no_edge_of_the_pattern_is_due(spy):
    guard = guard_of(spy, deadman_ms=150)
    send(guard, PULSE, 0)
    guard.advance(150 * MS)
    assert guard.next_edge_ns() is None


def test_a_failed_vibration_is_retried_after_a_second_exactly(spy):
    guard = guard_of(spy, deadman_ms=5000)
    guard.advance(0)
    spy.error = DeviceError("unplugged")
    for ms in range(10, 1000, 10):
        send(guard, LOW, ms)
    spy.error = None
    guard.advance(1010 * MS)
    assert spy.attempts_ms == [0, 10, 1010]
    assert spy.edges() == [(1010, 0.3)]


def test_a_failed_silence_is_retried_every_50_ms(spy):
    guard = guard_of(spy)
    spy.error = DeviceError("unplugged")
    for ms in range(0, 200, 10):
        send(guard, OFF, ms)
    assert spy.attempts_ms == [0, 50, 100, 150]


def test_a_failed_vibration_is_silenced_as_soon_as_silence_is_due(spy):
    guard = guard_of(spy, deadman_ms=150)
    guard.advance(0)
    spy.error = DeviceError("unplugged")
    send(guard, LOW, 10)
    guard.advance(200 * MS)
    assert spy.attempts_ms == [0, 10, 160]


def test_an_error_without_text_is_reported_by_its_type(spy):
    guard = guard_of(spy)
    spy.error = RuntimeError()
    send(guard, LOW, 0)
    assert guard.take_faults()[0].message == "RuntimeError"


def test_vibration_at_the_frequency_of_the_device_is_renewed_too():
    spy, guard = on_device(holds_ms=100)
    send(guard, replace(LOW, frequency_hz=0.0), 0)
    guard.advance(120 * MS)
    assert spy.edges() == [(0, 0.3), (50, 0.3), (100, 0.3)]
