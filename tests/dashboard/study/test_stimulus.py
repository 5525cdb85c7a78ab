"""A vibration outside a trial: as the guard allows it, on the device and on the pages, and silence after it."""

import pytest
import stuck_device
from helpers import LOW, MS, SUCCESS
from made_profiles import TEXT
from msgspec.structs import replace

from haptigraph import assemble, run_device
from haptigraph.clock import VirtualClock
from haptigraph.config import HapticsConfig
from haptigraph.dashboard.server.hub import Hub
from haptigraph.dashboard.study.stimulus import Stimulus, play_stimulus
from haptigraph.errors import BadInput, DeviceError, NotSilent
from haptigraph.messages import Capabilities


class Glove:
    """A device that keeps what it was set to."""

    def __init__(self, levels=255, fails=False):
        self.capabilities = Capabilities(levels, None, 0.0)
        self.fails, self.outputs, self.closed = fails, [], 0

    def __call__(self, argument):
        return self

    def set(self, amplitude, frequency_hz, stamp_ns):
        if self.fails and amplitude:
            raise DeviceError("unplugged")
        self.outputs.append((stamp_ns / MS, amplitude))

    def close(self):
        self.closed += 1


class Watched(Hub):
    """A hub that keeps what it would send to the pages."""

    def __init__(self, clock):
        super().__init__(clock)
        self.levels, self.alive_ms = [], []

    def record_level(self, stamp_ns, amplitude, frequency_hz):
        self.levels.append((stamp_ns / MS, amplitude))

    def keep_alive(self, stamp_ns):
        self.alive_ms.append(stamp_ns / MS)


@pytest.fixture
def play(monkeypatch):
    def played(pattern, glove, **settings):
        monkeypatch.setattr(run_device, "device_class", lambda kind: glove)
        clock = VirtualClock()
        needs_levels = settings.pop("needs_levels", False)
        hub = Watched(clock)
        stimulus = Stimulus("test", pattern, needs_levels)
        play_stimulus(
            stimulus, HapticsConfig(device="glove", **settings), clock, hub.record_level, hub.keep_alive
        )
        return hub

    return played


def test_a_burst_is_played_after_half_a_second_and_the_pages_hear_of_it_all_the_time(play):
    glove = Glove()
    hub = play(SUCCESS, glove)
    assert glove.outputs[:-1] == [(0, 0), (500, 0.8), (600, 0), (700, 0.8), (800, 0)]
    assert glove.outputs[-1] == (1000, 0)
    assert hub.levels == glove.outputs and glove.closed == 1
    gaps_ms = [after - before for before, after in zip(hub.alive_ms, hub.alive_ms[1:], strict=False)]
    assert max(gaps_ms) <= 40 and hub.alive_ms[0] == 0 and hub.alive_ms[-1] >= 900


def test_a_lasting_pattern_ends_after_a_second_within_the_limits_of_the_guard(play):
    glove = Glove()
    play(LOW, glove, max_amplitude=0.2)
    assert [level for _, level in glove.outputs if level] == [0.2]
    assert glove.outputs[1][0] == 500 and glove.outputs[2] == (1500, 0)
    silenced = Glove()
    play(LOW, silenced, max_amplitude=0.0)
    assert not any(level for _, level in silenced.outputs)


def test_a_profile_gives_the_drive_within_the_limits(play, tmp_path):
    path = tmp_path / "glove.toml"
    path.write_text(TEXT)
    for limit, drive in ((1.0, 0.6), (0.5, 0.5)):
        glove = Glove()
        play(replace(LOW, amplitude=0.5), glove, profile=str(path), max_amplitude=limit)
        assert [level for _, level in glove.outputs if level] == [pytest.approx(drive)]


def test_a_device_without_levels_is_refused_where_they_are_needed_and_stays_silent(play):
    motor = Glove(levels=1)
    with pytest.raises(BadInput, match="glove only knows on and off"):
        play(replace(LOW, amplitude=0.1), motor, needs_levels=True)
    assert motor.closed == 1 and not any(level for _, level in motor.outputs)


def test_a_device_that_fails_or_may_still_vibrate_is_reported(play, monkeypatch):
    with pytest.raises(DeviceError, match="glove: unplugged"):
        play(LOW, Glove(fails=True))
    monkeypatch.undo()
    monkeypatch.setitem(assemble.DEVICES, "stuck", stuck_device.PATH)
    clock = VirtualClock()
    hub = Hub(clock)
    with pytest.raises(NotSilent, match="may still vibrate"):
        play_stimulus(
            Stimulus("test", LOW), HapticsConfig(device="stuck"), clock, hub.record_level, hub.keep_alive
        )
