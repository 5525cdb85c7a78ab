import pytest
from helpers import LOW, MS, PULSE, SUCCESS
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.haptics.guidance import Guidance
from haptigraph.haptics.pattern import (
    amplitude_at,
    amplitude_range,
    duration_ns,
    fit_to_device,
    next_change_ns,
    unsupported,
    vibrating_ns,
    with_weakest,
)
from haptigraph.messages import OFF, Capabilities, HapticCommand, Pattern

patterns = st.sampled_from([OFF, LOW, PULSE, SUCCESS])


def at(pattern: Pattern, ms: float) -> float:
    return amplitude_at(HapticCommand(0, pattern, 0), round(ms * MS))


def test_a_continuous_pattern_never_pauses():
    assert [at(LOW, ms) for ms in (0, 1, 500, 100_000)] == [0.3] * 4


def test_pulses_alternate():
    assert [at(PULSE, ms) for ms in (0, 79, 80, 159, 160, 16_000)] == [1, 1, 0, 0, 1, 1]


def test_a_double_burst_plays_once():
    assert [at(SUCCESS, ms) for ms in (0, 99, 100, 199, 200, 299, 300, 400)] == [
        0.8,
        0.8,
        0,
        0,
        0.8,
        0.8,
        0,
        0,
    ]
    assert duration_ns(SUCCESS) == 300 * MS
    assert duration_ns(PULSE) is None


@given(patterns, st.integers(-(10**9), 10**10))
def test_the_amplitude_is_0_before_the_start_and_never_exceeds_that_of_the_pattern(pattern, stamp_ns):
    amplitude = amplitude_at(HapticCommand(0, pattern, 0), stamp_ns)
    assert amplitude in (0.0, pattern.amplitude)
    assert amplitude == 0 or stamp_ns >= 0


@given(patterns, st.integers(-(10**9), 10**9), st.integers(0, 2 * 10**9), st.integers(0, 10**9))
def test_vibrating_times_add_up_and_never_exceed_the_period(pattern, from_ns, first_ns, more_ns):
    command = HapticCommand(0, pattern, 0)
    middle_ns, end_ns = from_ns + first_ns, from_ns + first_ns + more_ns
    whole_ns = vibrating_ns(command, from_ns, end_ns)
    assert whole_ns == vibrating_ns(command, from_ns, middle_ns) + vibrating_ns(command, middle_ns, end_ns)
    assert 0 <= whole_ns <= end_ns - from_ns


@given(patterns, st.integers(-(10**9), 10**9), st.integers(-(10**9), 2 * 10**9))
def test_the_amplitude_is_constant_between_changes(pattern, since_ns, stamp_ns):
    command = HapticCommand(0, pattern, since_ns)
    change_ns = next_change_ns(command, stamp_ns)
    amplitude = amplitude_at(command, stamp_ns)
    if change_ns is None:
        assert all(amplitude_at(command, stamp_ns + later) == amplitude for later in (1, 10**6, 10**10))
    else:
        assert change_ns > stamp_ns
        assert amplitude_at(command, change_ns - 1) == amplitude
        assert amplitude_at(command, (stamp_ns + change_ns) // 2) == amplitude


@pytest.mark.parametrize(
    ("capabilities", "pattern", "sentences"),
    [
        (Capabilities(100, (0.0, 400.0), 0.0), PULSE, []),
        (Capabilities(100, None, 0.0), PULSE, ["pulse: the device has its own frequency, not 160 Hz"]),
        (Capabilities(100, (200.0, 400.0), 0.0), PULSE, ["pulse: 160 Hz is outside 200 to 400 Hz"]),
        (
            Capabilities(100, (0.0, 400.0), 100.0),
            PULSE,
            ["pulse: 80 ms on, 80 ms off become 100 on, 80 off; no shorter ones are felt"],
        ),
        (
            Capabilities(100, (0.0, 400.0), 0.0, 10.0),
            PULSE,
            ["pulse: 80 ms on, 80 ms off become 100 on, 100 off; no shorter ones are felt"],
        ),
        (Capabilities(1, (0.0, 400.0), 0.0), LOW, ["low: amplitude 0.3 becomes on or off"]),
        (Capabilities(1, None, 500.0), OFF, []),
    ],
)
def test_what_a_device_cannot_play_is_listed(capabilities, pattern, sentences):
    assert unsupported(pattern, capabilities) == sentences


@pytest.mark.parametrize(
    ("on_ms", "off_ms", "shortest_ms", "rate_hz", "played"),
    [
        (80, 80, 50, 20, (80, 80)),
        (30, 70, 50, None, (50, 50)),  # the onsets are kept
        (30, 40, 50, None, (50, 40)),  # a pause shorter than that is kept
        (30, 30, 0, 20, (50, 50)),
        (0, 50, 50, 20, (0, 50)),  # a pattern that is never on stays so
    ],
)
def test_a_rhythm_is_fitted_to_the_device(on_ms, off_ms, shortest_ms, rate_hz, played):
    pattern = Pattern("p", "pulses", 1.0, 0.0, on_ms, off_ms)
    fit = fit_to_device(pattern, Capabilities(1, None, shortest_ms, rate_hz))
    assert (fit.on_ms, fit.off_ms) == played


@pytest.mark.parametrize("name", procedure_names())
@pytest.mark.parametrize("weakest", [0.05, 0.2, 0.6])
def test_the_weakest_pattern_gets_its_amplitude_and_the_strongest_keeps_it(name, weakest):
    patterns = load_procedure(name).patterns
    mapped = with_weakest(patterns, weakest)
    assert amplitude_range(mapped) == pytest.approx((weakest, amplitude_range(patterns)[1]))
    by_amplitude = [sorted(each, key=lambda pattern: pattern.amplitude) for each in (patterns, mapped)]
    assert [each.name for each in by_amplitude[0]] == [each.name for each in by_amplitude[1]]
    assert [(each.kind, each.on_ms, each.name) for each in patterns] == [
        (each.kind, each.on_ms, each.name) for each in mapped
    ]


def test_a_pattern_that_follows_a_measure_is_mapped_over_its_whole_range():
    """Mapping and following commute: the amplitude at any angle is the mapped one."""
    patterns = load_procedure("subretinal_injection_continuous").patterns
    (lean,) = (pattern for pattern in patterns if pattern.name == "lean")
    (raised,) = (pattern for pattern in with_weakest(patterns, 0.4) if pattern.name == "lean")
    weakest, strongest = amplitude_range(patterns)
    for theta_deg in (0.0, 1.7, 3.0, 7.7, 10.0, 30.0):
        before, after = (Guidance()(each, {"theta_deg": theta_deg}).amplitude for each in (lean, raised))
        assert after == pytest.approx(0.4 + (before - weakest) * (strongest - 0.4) / (strongest - weakest))


def test_patterns_that_are_all_equally_strong_stay():
    assert with_weakest((OFF, PULSE), 0.3) == (OFF, PULSE)
    assert amplitude_range((OFF,)) == (0.0, 0.0)
