"""What an output confirmed: from the device through the loop and a recording to a measure."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.analysis.metrics.run import RunMeasures, measure_run
from haptigraph.analysis.metrics.summary import summary
from haptigraph.analysis.metrics.trial import measure_recording
from haptigraph.assemble import build
from haptigraph.clock import VirtualClock
from haptigraph.config import HapticsConfig, load_config
from haptigraph.dashboard.server.hub import Hub
from haptigraph.errors import DeviceError
from haptigraph.haptics.console import ConsoleDevice
from haptigraph.haptics.observed_device import ConfirmedDevice, DeliveryLog, confirms
from haptigraph.messages import Delivered
from haptigraph.recording.reader import RunReader

MS = 1_000_000


class Board:
    """A board that holds a command for 150 ms, and fails while `is_lost`."""

    capabilities = replace(ConsoleDevice.capabilities, holds_ms=150.0)
    is_lost = False

    def set(self, amplitude, frequency_hz, stamp_ns):
        if self.is_lost:
            raise DeviceError("lost")

    def close(self):
        pass


def test_a_device_is_logged_from_a_command_to_the_next_or_until_it_falls_silent():
    board, log = Board(), DeliveryLog()
    device = ConfirmedDevice(board, "serial:x", log)
    for at_ms, amplitude in ((0, 0.0), (10, 0.5), (80, 0.7), (100, 0.0), (200, 1.0), (400, 1.0)):
        device.set(amplitude, 160.0, at_ms * MS)
    board.is_lost = True
    for at_ms in (450, 500):
        with pytest.raises(DeviceError):
            device.set(1.0, 160.0, at_ms * MS)
    board.is_lost = False
    device.set(1.0, 160.0, 600 * MS)
    device.set(0.0, 0.0, 610 * MS)
    periods_ms = [(each.start_ns / MS, each.end_ns / MS) for each in log.take()]
    assert periods_ms == [(10, 80), (80, 100), (200, 350), (400, 450), (600, 610)]
    assert log.take() == ()


@pytest.mark.parametrize(
    ("output", "expected"),
    [
        ("", False),
        ("screen + sound", False),
        ("audio", False),
        ("ros2:joy", False),
        ("screen + serial:/dev/ttyACM0", True),
        ("gamepad:0", True),
        ("controller: Pad + sound", True),
    ],
)
def test_boards_and_controllers_confirm_and_nothing_else_does(output, expected):
    assert confirms(output) is expected


@pytest.fixture(scope="module")
def measured(quick_uri, tmp_path_factory):
    """Return the measures of a recorded run, and its run, for an output and what it confirmed."""
    folder = tmp_path_factory.mktemp("delivered")

    def record(number, output, *periods):
        path = folder / f"{number}.mcap"
        config = load_config(None, (f"source.uri={quick_uri}", "run.realtime=false"))
        config = replace(
            config,
            recording=replace(config.recording, path=str(path)),
            trial=replace(config.trial, touch_output=output),
        )
        loop = build(config)
        for period in periods:
            loop.deliveries.add(period)
        loop.run()
        return measure_recording(path), path

    return record


def test_an_output_that_confirms_nothing_has_no_time_and_one_that_does_has_its_own(measured):
    screen, path = measured("screen", "screen")
    assert screen["touch_output"] == "screen" and "delivered_s" not in screen
    run = measure_run(step for _, step in RunReader(path).records(images=()))
    dead, _ = measured("dead", "controller: Pad")
    assert (dead["touch_output"], dead["delivered_s"]) == ("controller: Pad", 0.0)
    at_ns = run.started_ns
    periods = [(-500, 100), (50, 200), (300, 400), (350, 360)]  # before the run, and overlapping
    periods = [Delivered(at_ns + a * MS, at_ns + b * MS, "controller") for a, b in periods]
    felt, path = measured("felt", "controller: Pad + screen", *periods)
    assert felt["delivered_s"] == pytest.approx(0.3)
    assert felt["vibrating_s"] == screen["vibrating_s"] > 0
    captures = [capture for capture, _ in RunReader(path).records(images=())]
    assert captures[0].delivered == tuple(periods) and not any(each.delivered for each in captures[1:])


@given(st.floats(0, 1e6), st.floats(0, 1e6))
def test_a_page_reports_no_vibration_in_the_future_and_none_without_length(start_ms, end_ms):
    clock = VirtualClock()
    hub = Hub(clock)
    clock.wait_until(clock.now_ns() + 1000 * MS)
    hub.log_played("controller", start_ms, end_ms)
    for period in hub.deliveries.take():
        assert period.start_ns < period.end_ns <= clock.now_ns()
        assert (period.end_ns - period.start_ns) / MS <= end_ms - start_ms + 1e-3


def test_a_run_reports_what_was_confirmed_beside_what_was_commanded(quick_uri):
    loop = build(load_config(None, (f"source.uri={quick_uri}", "run.realtime=false")))
    assert loop.report.confirmed_s == {}
    loop.report.note_limits((), HapticsConfig(device="serial:x"))
    measures, at_ns = RunMeasures(), 0
    for number, step in enumerate(loop.steps()):
        measures.add(step)
        if number in (40, 50):
            loop.deliveries.add(Delivered(at_ns, at_ns + 70 * MS, "serial:x"))
    assert loop.report.confirmed_s == {"serial:x": pytest.approx(0.14)}
    assert measures.vibrating_s["low"] > 2 and "off" not in measures.vibrating_s
    lines = summary(measures, loop.report).splitlines()
    at = next(number for number, line in enumerate(lines) if line.startswith("vibration"))
    assert f"low {measures.vibrating_s['low']:.2f} s" in lines[at]
    assert lines[at + 1].split() == ["confirmed", "for", "0.14", "s", "by", "serial:x"]
    assert "confirmed" not in summary(measures) and "vibration       none" in summary(RunMeasures())
