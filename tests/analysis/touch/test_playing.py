"""Play a vibration: through the guard, within its limits, silent at every end."""

from itertools import pairwise

import pytest
from helpers import MS, PULSE, SUCCESS

from haptigraph.analysis.touch.loading import Touch, touch_from
from haptigraph.analysis.touch.playing import play_touch
from haptigraph.clock import VirtualClock
from haptigraph.config import HapticsConfig
from haptigraph.haptics.audio import AudioDevice
from haptigraph.haptics.formats.envelope import Envelope, Transient, enveloped
from haptigraph.haptics.formats.files import read_envelope
from haptigraph.haptics.formats.fitting import fit
from haptigraph.messages import Capabilities, Pattern

FADE = touch_from(Envelope(((0.0, 1.0), (200.0, 0.0), (300.0, 0.0)), ((0.0, 100.0), (300.0, 100.0))), "fade")


class Actuator:
    def __init__(self, capabilities=Capabilities(255, (0.0, 1000.0), 0.0)):  # noqa: B008 - frozen
        self.capabilities, self.commands, self.closed = capabilities, [], 0

    def set(self, amplitude, frequency_hz, stamp_ns):
        self.commands.append((stamp_ns / MS, amplitude, frequency_hz))

    def close(self):
        self.closed += 1


def played(touch, config=HapticsConfig(), **capabilities):  # noqa: B008 - frozen
    actuator = Actuator(
        Capabilities(
            **{"amplitude_levels": 255, "frequency_range_hz": None, "shortest_on_ms": 0.0} | capabilities
        )
    )
    start_ms = VirtualClock().now_ns() / MS
    test = play_touch(actuator, touch, VirtualClock(), config)
    assert test.is_silent
    assert actuator.closed == 1
    assert actuator.commands[0][1] == 0  # the guard's first command
    return [(ms - start_ms, amplitude, hertz) for ms, amplitude, hertz in actuator.commands[1:]], test


def test_a_pattern_is_played_as_in_a_run():
    commands, _ = played(Touch("p", enveloped(PULSE, 320), PULSE), shortest_on_ms=100.0)
    on_ms = [ms for ms, amplitude, _ in commands if amplitude]
    off_ms = [ms for ms, amplitude, _ in commands if not amplitude]
    assert on_ms[:2] == pytest.approx([0, 180])  # lengthened to what the device can do
    assert off_ms[0] == pytest.approx(100)


def test_an_envelope_without_a_pattern_is_followed():
    assert FADE.pattern is None
    commands, _ = played(FADE)
    for ms, amplitude, hertz in commands:
        assert amplitude == pytest.approx(max(0, 1 - ms / 200), abs=0.06)
        assert hertz == (100 if amplitude else 0)
    assert len(commands) >= 20
    assert commands[-1][1] == 0


def test_a_slow_device_gets_fewer_changes_and_silence_in_time():
    commands, _ = played(FADE, max_rate_hz=20.0)
    times_ms = [ms for ms, amplitude, _ in commands if amplitude]
    assert min(after - before for before, after in pairwise(times_ms)) >= 50
    assert min(ms for ms, amplitude, _ in commands if not amplitude) == pytest.approx(200, abs=1)


def test_a_transient_is_played_over_what_vibrates():
    both = touch_from(Envelope(((0.0, 0.4), (100.0, 0.4)), (), (Transient(55, 0.9, 200),)), "p")
    commands, _ = played(both)
    assert (55, 0.9, 200) in [(round(ms), amplitude, hertz) for ms, amplitude, hertz in commands]
    assert (77, 0.4, 0) in [(round(ms), amplitude, hertz) for ms, amplitude, hertz in commands]


@pytest.mark.parametrize(
    "touch", [FADE, Touch("p", enveloped(PULSE, 320), PULSE)], ids=["envelope", "pattern"]
)
def test_no_file_lifts_the_limits(touch):
    commands, _ = played(touch, HapticsConfig(max_amplitude=0.25))
    assert max(amplitude for _, amplitude, _ in commands) == 0.25


def test_a_vibration_that_is_too_long_pauses():
    wobble = Envelope(tuple((100.0 * at, 0.5 + 0.3 * (at % 2)) for at in range(20)))
    commands, test = played(touch_from(wobble, "p"), HapticsConfig(max_on_ms=500, rest_ms=200))
    assert any("vibration paused" in fault.message for fault in test.faults)
    assert 500 in [round(ms) for ms, amplitude, _ in commands if not amplitude]


def test_a_device_that_fails_is_closed_and_reported():
    class Broken(Actuator):
        def set(self, amplitude, frequency_hz, stamp_ns):
            if amplitude:
                raise OSError("unplugged")
            super().set(amplitude, frequency_hz, stamp_ns)

    actuator = Broken()
    test = play_touch(actuator, FADE, VirtualClock(), HapticsConfig())
    assert actuator.closed == 1
    assert [fault.message for fault in test.faults] == ["unplugged"]


def test_an_interrupt_leaves_the_device_silent():
    class Interrupted(Actuator):
        def set(self, amplitude, frequency_hz, stamp_ns):
            super().set(amplitude, frequency_hz, stamp_ns)
            if len(self.commands) == 5:
                raise KeyboardInterrupt

    actuator = Interrupted()
    with pytest.raises(KeyboardInterrupt):
        play_touch(actuator, FADE, VirtualClock(), HapticsConfig())
    assert actuator.commands[-1][1] == 0
    assert actuator.closed == 1


def test_what_the_sound_device_writes_is_read_back(tmp_path):
    path = tmp_path / "s.wav"
    play_touch(
        AudioDevice(str(path)), Touch("s", enveloped(SUCCESS, 0), SUCCESS), VirtualClock(), HapticsConfig()
    )
    found = fit(read_envelope(path), "s").pattern
    assert (found.kind, found.count) == ("bursts", 2)
    assert found.amplitude == pytest.approx(0.8, rel=0.01)
    assert found.frequency_hz == pytest.approx(160, abs=0.1)
    assert found.on_ms == pytest.approx(104, abs=2)  # with the ramp of the device after the burst
    assert found.on_ms + found.off_ms == pytest.approx(200, abs=1)


def test_a_pattern_that_does_not_vibrate_is_silent():
    off = Pattern("off", "off")
    commands, _ = played(Touch("off", enveloped(off, 200), off))
    assert {amplitude for _, amplitude, _ in commands} == {0}
