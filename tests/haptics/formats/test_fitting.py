"""Envelopes of patterns, the pattern of an envelope, and how far two are apart."""

import math

import pytest
from helpers import LOW, PULSE, SUCCESS
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.haptics.formats.curve import value_after
from haptigraph.haptics.formats.envelope import (
    TRANSIENT_MS,
    Envelope,
    Transient,
    difference,
    enveloped,
    pieces,
    plain,
)
from haptigraph.haptics.formats.fitting import fit
from haptigraph.haptics.pattern import amplitude_at
from haptigraph.messages import OFF, HapticCommand, Pattern

MS = 1_000_000
FADE = Envelope(((0.0, 1.0), (300.0, 0.0)), ((0.0, 100.0), (300.0, 50.0)))


def patterns():
    """Every kind, with numbers that a procedure may have."""
    numbers = {
        "name": st.just("p"),
        "amplitude": st.integers(1, 100).map(lambda percent: percent / 100),
        "frequency_hz": st.sampled_from([0.0, 60.0, 160.0, 250.0]),
    }
    rhythm = {"on_ms": st.integers(1, 400).map(float), "off_ms": st.integers(1, 900).map(float)}
    return st.one_of(
        st.just(OFF),
        st.builds(Pattern, kind=st.just("continuous"), **numbers),
        st.builds(Pattern, kind=st.just("pulses"), **numbers, **rhythm),
        st.builds(Pattern, kind=st.just("bursts"), **numbers, **rhythm, count=st.integers(1, 5)),
    )


@given(patterns(), st.integers(0, 2500))
def test_an_envelope_is_what_the_pattern_plays(pattern, time_ms):
    envelope = enveloped(pattern, 2000)
    if time_ms < envelope.duration_ms:
        played = amplitude_at(HapticCommand(0, pattern, 0), time_ms * MS)
        assert value_after(envelope.amplitude, time_ms) == played


@given(patterns())
def test_a_pattern_comes_back_from_its_envelope(pattern):
    found = fit(enveloped(pattern, 2000), "p")
    assert found.is_exact
    assert found.error.frequency_hz == 0
    back = found.pattern
    assert (back.kind, back.amplitude, back.count) == (pattern.kind, pattern.amplitude, pattern.count)
    assert back.on_ms == pattern.on_ms
    assert back.off_ms == pattern.off_ms or pattern.count == 1  # a single burst has no pause


def test_what_does_not_repeat_becomes_bursts():
    envelope = enveloped(PULSE, 480)
    once = Envelope(envelope.amplitude, envelope.frequency_hz)
    assert fit(once, "p").pattern.kind == "bursts"
    assert fit(once, "p").pattern.count == 3
    assert fit(Envelope(((0.0, 0.4), (500.0, 0.4))), "p").pattern.count == 1


def test_a_transient_is_a_burst():
    clicks = tuple(Transient(at_ms, 0.7, 200) for at_ms in (0.0, 100.0))
    found = fit(Envelope(((0.0, 0.0), (122.0, 0.0)), (), clicks), "clicks")
    assert found.is_exact
    assert (found.pattern.on_ms, found.pattern.off_ms, found.pattern.count) == (TRANSIENT_MS, 78, 2)
    assert found.pattern.frequency_hz == 200


def test_a_fade_fits_no_pattern():
    found = fit(FADE, "fade")
    assert not found.is_exact
    assert found.error.amplitude > 0.2
    assert found.pattern.kind == "bursts"


@pytest.mark.parametrize(
    "amplitude",
    [((0.0, 0.0), (10.0, 0.0)), ((0.0, 0.0), (10.0, 0.0), (10.0, 0.9))],
    ids=["zero", "at its end"],
)
def test_silence_is_off(amplitude):
    assert fit(Envelope(amplitude), "p").pattern == Pattern("p", "off")


def test_differences_are_seen():
    first = enveloped(SUCCESS, 0)
    weaker = enveloped(Pattern("s", "bursts", 0.72, 160, 100, 100, 2), 0)
    later = enveloped(Pattern("s", "bursts", 0.8, 160, 103, 100, 2), 0)
    higher = enveloped(Pattern("s", "bursts", 0.8, 170, 100, 100, 2), 0)
    three = enveloped(Pattern("s", "bursts", 0.8, 160, 100, 100, 3), 0)
    silent = enveloped(OFF, 300)
    unstated = enveloped(Pattern("s", "bursts", 0.8, 0, 100, 100, 2), 0)
    assert difference(first, first) == difference(weaker, weaker)
    assert difference(first, weaker).amplitude == pytest.approx(0.1)
    assert difference(first, later).timing_ms == pytest.approx(6)
    assert difference(first, later).amplitude == 0
    assert difference(first, higher).frequency_hz == pytest.approx(10)
    assert difference(first, three).timing_ms == math.inf
    assert difference(first, silent).amplitude == pytest.approx(1)
    assert difference(first, unstated).frequency_hz == math.inf


def test_a_longer_pause_at_the_end_is_a_difference():
    assert difference(enveloped(PULSE, 480), enveloped(PULSE, 640)).timing_ms == math.inf
    longer = Envelope((*enveloped(SUCCESS, 0).amplitude, (300.0, 0.0), (350.0, 0.0)))
    assert difference(enveloped(SUCCESS, 0), longer).timing_ms == 50


def test_an_envelope_is_cut_at_steps_and_pauses():
    assert len(pieces(enveloped(SUCCESS, 0))) == 2
    assert len(pieces(enveloped(PULSE, 320))) == 3  # with the pause at the end
    assert len(pieces(enveloped(LOW, 500))) == 1
    assert pieces(FADE)[0].amplitude == FADE.amplitude


def test_a_transient_is_merged_with_what_vibrates():
    merged = plain(
        Envelope(((0.0, 0.3), (100.0, 0.3)), ((0.0, 60.0), (100.0, 60.0)), (Transient(90, 1.0, 200),))
    )
    assert merged.duration_ms == 90 + TRANSIENT_MS
    assert merged.peak == 1.0
    assert merged.transients == ()
