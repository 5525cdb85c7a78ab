"""A profile behind the guard: patterns become drives, and every limit applies to the drive."""

import pytest
from helpers import LOW, MS, PULSE, make_step
from hypothesis import given
from hypothesis import strategies as st
from made_profiles import TEXT, profiles
from msgspec.structs import replace

from haptigraph.config import HapticsConfig
from haptigraph.haptics.guard import Guard
from haptigraph.haptics.profiles.fit import misfits, profile_notes, unmeasured
from haptigraph.haptics.profiles.profile import parse_profile
from haptigraph.messages import OFF, UNKNOWN, Capabilities, Pattern

PROFILE = parse_profile(TEXT, "p.toml")


class Spy:
    capabilities = Capabilities(65535, None, 50.0)

    def __init__(self):
        self.log = []

    def set(self, amplitude, frequency_hz, stamp_ns):
        self.log.append((stamp_ns / MS, amplitude))

    def close(self):
        self.log.append((0, 0.0))


def played(pattern, profile=PROFILE, state="some_state", **settings):
    spy = Spy()
    guard = Guard(spy, HapticsConfig(**settings), profile)
    for ms in range(0, 400, 33):
        guard.send(make_step(pattern, stamp_ns=ms * MS, since_ns=0, state=state), ms * MS)
    return spy.log


def test_an_amplitude_is_played_with_the_drive_that_feels_as_strong():
    log = played(replace(LOW, amplitude=0.5))
    assert [drive for _, drive in log] == [0.0, pytest.approx(0.6)]


def test_short_bursts_are_lengthened_to_the_measured_onset():
    log = played(replace(PULSE, on_ms=30, off_ms=130))
    assert [ms for ms, _ in log[1:4]] == [0, 62, 160]
    assert [ms for ms, _ in played(replace(PULSE, on_ms=30, off_ms=130), replace(PROFILE, onset=None))[1:4]] == [0, 50, 160]  # fmt: skip


@given(profiles(), st.floats(0, 2), st.floats(0, 1))
def test_no_profile_carries_a_drive_beyond_the_limit(profile, amplitude, limit):
    pattern = Pattern("any", "continuous", amplitude, 160.0)
    assert all(0 <= drive <= limit for _, drive in played(pattern, profile, max_amplitude=limit))


@pytest.mark.parametrize("pattern", [OFF, replace(LOW, amplitude=0.0), replace(LOW, amplitude=float("nan"))])
def test_silence_stays_silence(pattern):
    assert {drive for _, drive in played(pattern)} == {0.0}


def test_what_is_unknown_is_silent_with_a_profile_too():
    assert {drive for _, drive in played(LOW, state=UNKNOWN)} == {0.0}


def test_what_is_too_weak_or_perhaps_not_felt_is_said():
    weak = replace(LOW, amplitude=0.02)
    assert misfits(replace(LOW, amplitude=0.5), PROFILE) == []
    assert misfits(PULSE, PROFILE) == [
        "pulse: amplitude 1 is felt as 0.8, the strongest that is known of the device"
    ]
    (limited,) = misfits(replace(LOW, amplitude=0.5), PROFILE, 0.3)
    assert (
        limited == "low: amplitude 0.5 is felt as 0.2, the strongest that the limit of the amplitude allows"
    )
    (unfelt,) = misfits(weak, PROFILE)
    assert unfelt == "low: amplitude 0.02 may not be felt: its drive is 0.12, the threshold 0.08 to 0.12"
    assert misfits(OFF, PROFILE) == []


def test_other_frequencies_than_the_measured_one_are_unknown():
    at_160 = replace(PROFILE, intensity=replace(PROFILE.intensity, frequency_hz=160.0))
    assert unmeasured([LOW, PULSE], PROFILE) == []
    (sentence,) = unmeasured([replace(LOW, frequency_hz=80.0), PULSE, OFF], at_160)
    assert "low (80 Hz)" in sentence and "pulse" not in sentence


def test_a_run_says_whose_profile_it_is_and_on_what_it_was_measured():
    notes = profile_notes(PROFILE, "gamepad:1", [LOW], 1.0)
    assert notes[0].endswith("by the profile of gamepad:0 (answers: P01, 2026-11-26)")
    assert "the profile was measured on gamepad:0, not on gamepad:1" in notes
    own = replace(PROFILE, intensity=replace(PROFILE.intensity, scale="own"))
    assert any("own strongest" in note for note in profile_notes(own, "gamepad:0", [LOW], 1.0))
