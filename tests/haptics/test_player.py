import sys
import threading
from functools import partial

import pytest
from helpers import LOW, every_moment, make_step

from haptigraph.clock import MonotonicClock
from haptigraph.config import HapticsConfig
from haptigraph.haptics import player as player_module
from haptigraph.haptics.guard import Guard
from haptigraph.haptics.player import Player
from haptigraph.messages import Capabilities

PATIENCE_S = 10.0


class Signalling:
    """A device that signals its output."""

    capabilities = Capabilities(100, None, 0.0)

    def __init__(self):
        self.vibrates, self.is_silent, self.is_closed = (threading.Event() for _ in range(3))
        self.silences: list[int] = []
        self.gate = threading.Event()
        self.gate.set()

    def set(self, amplitude, frequency_hz, stamp_ns):
        self.gate.wait(PATIENCE_S)
        if amplitude:
            self.is_silent.clear()
            self.vibrates.set()
        else:
            self.silences.append(stamp_ns)
            self.is_silent.set()

    def close(self):
        self.is_closed.set()


@pytest.fixture
def device():
    return Signalling()


def start(device, **settings):
    clock = MonotonicClock()
    return Player(Guard(device, HapticsConfig(**settings)), clock), clock


def test_the_actuator_is_silenced_when_the_loop_sends_no_more(device):
    player, clock = start(device, deadman_ms=50)
    sent_ns = clock.now_ns()
    player.send(make_step(LOW, stamp_ns=sent_ns), sent_ns)
    assert device.vibrates.wait(PATIENCE_S)
    assert device.is_silent.wait(PATIENCE_S)
    assert device.silences[-1] - sent_ns >= 50e6
    player.close()


def test_closing_silences_the_actuator_and_releases_the_device(device):
    player, clock = start(device, deadman_ms=1000)
    player.send(make_step(LOW, stamp_ns=clock.now_ns()), clock.now_ns())
    assert device.vibrates.wait(PATIENCE_S)
    player.close()
    player.close()
    assert device.is_silent.is_set()
    assert device.is_closed.is_set()
    assert player.is_silent


def test_a_device_that_blocks_does_not_block_the_loop(device, monkeypatch):
    monkeypatch.setattr(player_module, "SILENCE_TIMEOUT_S", 0.05)
    device.gate.clear()
    player, clock = start(device)
    for _ in range(100):
        player.send(make_step(LOW, stamp_ns=clock.now_ns()), clock.now_ns())
    player.close()
    assert "does not respond; it may still vibrate" in player.take_faults()[-1].message
    assert not player.is_silent
    device.gate.set()
    assert device.is_closed.wait(PATIENCE_S)


def test_steps_do_not_accumulate_before_a_device_that_blocks(device):
    device.gate.clear()
    player, clock = start(device)
    steps = [make_step(LOW, stamp_ns=clock.now_ns()) for _ in range(100)]
    before = list(map(sys.getrefcount, steps))
    for step in steps:
        player.send(step, step.stamp_ns)
    kept = sum(now > then for now, then in zip(map(sys.getrefcount, steps), before, strict=True))
    device.gate.set()
    player.close()
    assert 1 <= kept <= 4  # the current one, the next, and the last one taken


def test_faults_of_the_device_are_reported(device):
    class Broken(Signalling):
        def set(self, amplitude, frequency_hz, stamp_ns):
            raise OSError("unplugged")

    broken = Broken()
    player, clock = start(broken)
    player.send(make_step(LOW, stamp_ns=clock.now_ns()), clock.now_ns())
    player.close()
    assert {fault.message for fault in player.take_faults()} == {"unplugged"}


@pytest.mark.parametrize("error", [ValueError("odd"), SystemExit(3)])
def test_a_failure_of_the_guard_silences_the_actuator_and_is_reported_and_survived(device, error):
    class Failing(Guard):
        fails = False

        def send(self, step, now_ns):
            if self.fails:
                raise error
            super().send(step, now_ns)

    clock = MonotonicClock()
    guard = Failing(device, HapticsConfig(deadman_ms=1000))
    player = Player(guard, clock)
    player.send(make_step(LOW, stamp_ns=clock.now_ns()), clock.now_ns())
    assert device.vibrates.wait(PATIENCE_S)
    device.is_silent.clear()
    guard.fails = True
    player.send(make_step(LOW, stamp_ns=clock.now_ns()), clock.now_ns())
    assert device.is_silent.wait(PATIENCE_S)
    guard.fails = False
    device.vibrates.clear()
    player.send(make_step(LOW, stamp_ns=clock.now_ns()), clock.now_ns())
    assert device.vibrates.wait(PATIENCE_S)
    player.close()
    (fault,) = player.take_faults()
    assert (fault.where, fault.message) == (
        "guard",
        f"{type(error).__name__}: {error}; output silenced",
    )


@pytest.mark.parametrize(
    "call", [Player.send, lambda player, *_: player.take_faults()], ids=("send", "faults")
)
def test_after_ctrl_c_at_any_moment_the_actuator_can_be_silenced(call):
    for moment, pressing_ctrl_c in enumerate(every_moment()):
        device = Signalling()
        player, clock = start(device, deadman_ms=1000)
        step = make_step(LOW, stamp_ns=clock.now_ns())
        player.send(step, clock.now_ns())
        assert device.vibrates.wait(PATIENCE_S)
        pressing_ctrl_c(partial(call, player, step, step.stamp_ns))
        player.close()
        assert device.is_silent.is_set(), f"at moment {moment}"
        assert device.is_closed.is_set(), f"at moment {moment}"
