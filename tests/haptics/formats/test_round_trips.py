"""The law of every format: a pattern that is written and read back is the same, within 1 % and 2 ms."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.haptics.formats.curve import value_after
from haptigraph.haptics.formats.envelope import Envelope, Transient, difference, enveloped
from haptigraph.haptics.formats.files import FORMATS, checked
from haptigraph.haptics.formats.fitting import fit
from haptigraph.messages import Pattern

SHIPPED = {name: load_procedure(name).patterns for name in procedure_names()}
TEXT = [ending for ending in FORMATS if ending != ".wav"]
CYCLES = 4  # of its frequency in a burst, from which a sound says amplitude and frequency


def through(ending, envelope):
    return checked(FORMATS[ending].read(FORMATS[ending].write(envelope, "name"), "file"), "file")


def test_there_are_patterns_of_every_kind():
    assert {p.kind for each in SHIPPED.values() for p in each} == {"off", "continuous", "pulses", "bursts"}


@pytest.mark.parametrize("ending", FORMATS)
@pytest.mark.parametrize("procedure", SHIPPED)
def test_every_shipped_pattern_survives(procedure, ending):
    for pattern in SHIPPED[procedure]:
        envelope = enveloped(pattern, 2000)
        back = through(ending, envelope)
        found = fit(back, pattern.name)
        for error in (difference(envelope, back), difference(envelope, enveloped(found.pattern, 2000))):
            assert error.amplitude <= 0.01
            assert error.timing_ms <= 2
            assert error.frequency_hz <= 0.1
        assert found.is_exact
        assert (found.pattern.kind, found.pattern.count) == (pattern.kind, pattern.count)


@st.composite
def patterns(draw):
    """Patterns whose bursts have enough cycles for a sound."""
    frequency_hz = float(draw(st.integers(50, 300)))
    shortest_ms = int(CYCLES * 1000 / frequency_hz) + 1
    return Pattern(
        "p",
        draw(st.sampled_from(["pulses", "bursts"])),
        amplitude=draw(st.integers(2, 100)) / 100,
        frequency_hz=frequency_hz,
        on_ms=float(draw(st.integers(shortest_ms, 300))),
        off_ms=float(draw(st.integers(3, 300))),
        count=draw(st.integers(1, 4)),
    )


@pytest.mark.parametrize("ending", FORMATS)
@given(patterns())
def test_random_patterns_survive(ending, pattern):
    if pattern.kind == "pulses":
        pattern = Pattern(
            "p", "pulses", pattern.amplitude, pattern.frequency_hz, pattern.on_ms, pattern.off_ms
        )
    envelope = enveloped(pattern, 900)
    error = difference(envelope, through(ending, envelope))
    assert error.amplitude <= 0.01
    assert error.timing_ms <= 2
    assert error.frequency_hz <= 1


@pytest.mark.parametrize("ending", TEXT)
@given(
    st.lists(
        st.tuples(st.integers(1, 500), st.integers(0, 20)), min_size=2, max_size=30, unique_by=lambda p: p[0]
    ),
    st.lists(st.tuples(st.integers(50, 300), st.integers(50, 300)), max_size=1),
)
def test_random_envelopes_survive(ending, points, sweep):
    levels = tuple((float(time_ms), level / 20) for time_ms, level in sorted(points))
    amplitude = ((0.0, levels[0][1]), *levels)
    end_ms = amplitude[-1][0]
    frequency_hz = tuple(((0.0, float(first)), (end_ms, float(last))) for first, last in sweep)
    envelope = Envelope(amplitude, frequency_hz[0] if frequency_hz else ((0.0, 160.0), (end_ms, 160.0)))
    error = difference(envelope, through(ending, envelope))
    assert error.amplitude <= 0.01
    assert error.timing_ms <= 2
    assert error.frequency_hz <= 1


@pytest.mark.parametrize("ending", TEXT)
def test_transients_survive(ending):
    clicks = (Transient(20.0, 0.5, 100.0), Transient(60.0, 1.0, 300.0))
    back = through(ending, Envelope(((0.0, 0.0), (100.0, 0.0)), (), clicks))
    assert [(one.time_ms, one.amplitude, one.frequency_hz) for one in back.transients] == [
        (20.0, 0.5, pytest.approx(100)),
        (60.0, 1.0, pytest.approx(300)),
    ]
    assert back.duration_ms == 100


@pytest.mark.parametrize("ending", FORMATS)
@pytest.mark.parametrize("repeats", [False, True])
def test_only_what_repeats_repeats(ending, repeats):
    assert through(ending, Envelope(((0.0, 0.5), (200.0, 0.5)), repeats=repeats)).repeats == repeats


@pytest.mark.parametrize(
    ("ending", "played_hz"), [(".haptic", 0), (".ahap", 0), (".hjif", 160), (".wav", 160)]
)
def test_no_frequency_is_the_devices_choice_where_the_format_can_say_so(ending, played_hz):
    back = through(ending, enveloped(Pattern("p", "continuous", 0.5), 500))
    assert value_after(back.frequency_hz, 100) == pytest.approx(played_hz)
