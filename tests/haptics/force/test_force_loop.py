"""The loop of a force device: zero first, force by the step's fixtures, and no end without letting go."""

import math

import pytest
from helpers import MS

from haptigraph.clock import VirtualClock
from haptigraph.errors import DeviceError
from haptigraph.haptics.force.fixture import Fixture
from haptigraph.haptics.force.interface import ForceCapabilities, HandReading
from haptigraph.haptics.force.loop import PERIOD_NS, ForceLoop
from haptigraph.haptics.force.messages import ForceInput, ForceReport
from haptigraph.haptics.force.renderer import ForceRenderer

WALL = Fixture("plane", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), stiffness_n_per_mm=0.2, limit_n=2.0)
TIP_MM = (0.0, -5.0, 0.0)  # 5 mm beyond the wall: a full force of 1 N at scale 1
ZERO = (0.0, 0.0, 0.0)
CAPABILITIES = ForceCapabilities(3.0, 1000.0, 250.0)


class Bench:
    """The loop on a virtual clock, with its device, its inputs and its reports."""

    capabilities = CAPABILITIES

    def __init__(self):
        self.clock = VirtualClock(1000 * MS)
        self.forces, self.reports = [], []
        self.position_mm, self.is_engaged, self.is_closed = ZERO, True, False
        self.inputs: list[list[ForceInput] | None] = []
        self.feeds, self.fails, self.scale = True, "", 1.0
        renderer = ForceRenderer(CAPABILITIES, deadman_ms=150.0)
        self.loop = ForceLoop(self, renderer, self.clock, self, self)

    def take(self):
        """Of the inputs: a step every 33 ms, whose image is 5 ms old."""
        if self.inputs:
            return self.inputs.pop(0)
        now_ns = self.clock.now_ns()
        if not self.feeds or now_ns // MS % 33:
            return []
        return [ForceInput((WALL,), TIP_MM, now_ns - 5 * MS, self.scale)]

    def send(self, message: ForceReport):
        self.reports.append(message)

    def exchange(self, force_n):
        if self.fails == "raise":
            raise DeviceError("unplugged")
        self.forces.append((self.clock.now_ns(), force_n))
        position_mm = (math.nan,) * 3 if self.fails == "nan" else self.position_mm
        return HandReading(self.clock.now_ns(), position_mm, ZERO, self.is_engaged)

    def close(self):
        self.is_closed = True
        if self.fails == "close":
            raise DeviceError("may still push")

    def run_ms(self, ms):
        for _ in range(ms):
            assert self.loop.cycle()
        return self.newton

    @property
    def newton(self):
        return self.forces[-1][1][1]

    @property
    def problems(self):
        return [problem for report in self.reports for problem in report.problems]


def test_it_starts_with_zero_and_reaches_the_force_of_the_fixture():
    bench = Bench()
    assert bench.forces == [(1000 * MS, ZERO)]
    assert bench.run_ms(1000) == pytest.approx(1.0)
    assert max(abs(b[1][1] - a[1][1]) for a, b in zip(bench.forces, bench.forces[1:], strict=False)) <= 0.11


@pytest.mark.parametrize("scale", [0.2, 0.5, 1.0])
def test_the_hand_feels_the_way_that_it_would_have_to_go_back(scale):
    bench = Bench()
    bench.scale = scale
    assert bench.run_ms(1000) == pytest.approx(min(0.2 * 5.0 / scale, 2.0))


def test_fixtures_are_placed_about_the_hand_as_it_was_when_the_image_was_taken():
    bench = Bench()
    bench.run_ms(1000)
    bench.feeds, bench.position_mm = False, (0.0, 0.2, 0.0)  # after the last image
    bench.run_ms(50)
    assert bench.newton == pytest.approx(0.2 * 4.8, abs=0.01)


def test_an_image_from_before_the_clutch_was_pressed_pushes_nobody():
    bench = Bench()
    bench.is_engaged, bench.feeds = False, False
    bench.run_ms(300)
    bench.is_engaged = True
    bench.inputs = [[], [ForceInput((WALL,), TIP_MM, bench.clock.now_ns() - MS, 1.0)]]
    assert bench.run_ms(100) == 0.0
    bench.feeds = True
    assert bench.run_ms(600) == pytest.approx(1.0)


def test_a_clutch_that_is_released_lets_go():
    bench = Bench()
    bench.run_ms(1000)
    bench.is_engaged = False
    assert bench.run_ms(20) == 0.0
    assert not bench.problems


def test_a_step_without_fixtures_lets_go():
    bench = Bench()
    bench.run_ms(1000)
    bench.feeds, bench.inputs = False, [[ForceInput((), ZERO, bench.clock.now_ns(), 1.0)]]
    assert bench.run_ms(100) == 0.0


def test_a_run_that_is_silent_lets_go_after_the_dead_man_time():
    bench = Bench()
    bench.run_ms(1000)
    bench.feeds = False
    assert bench.run_ms(115) > 0.5
    assert bench.run_ms(60) == 0.0
    assert bench.problems == ["no fixtures arrived for 150 ms"]


def test_a_loop_that_stalls_lets_go_and_counts_what_it_missed():
    bench = Bench()
    bench.run_ms(1000)
    bench.clock.wait_until(bench.clock.now_ns() + 50 * PERIOD_NS)
    assert bench.run_ms(20) == 0.0
    assert "stopped for" in bench.problems[0]
    assert bench.reports[-1].missed in range(48, 51)
    assert bench.run_ms(1000) == pytest.approx(1.0)


def test_a_position_that_is_not_finite_lets_go():
    bench = Bench()
    bench.run_ms(1000)
    bench.fails = "nan"
    assert bench.run_ms(20) == 0.0
    assert "not a number" in bench.problems[0]


@pytest.mark.parametrize("how", ["end of input", "SIGTERM"])
def test_the_end_lets_go_in_20_ms_without_a_step_and_closes_the_device(how):
    bench = Bench()
    bench.run_ms(1000)
    began_ns = bench.clock.now_ns()
    if how == "SIGTERM":
        bench.loop.end()
    else:
        bench.inputs = [None]
    bench.loop.run()
    assert bench.is_closed and bench.forces[-1][1] == ZERO
    assert bench.forces[-1][0] - began_ns <= 20 * MS
    after = [force[1] for at_ns, force in bench.forces if at_ns >= began_ns]
    assert len(after) > 5 and after == sorted(after, reverse=True)


def test_a_device_that_fails_is_closed_and_the_failure_is_reported():
    bench = Bench()
    bench.run_ms(1000)
    bench.fails = "raise"
    bench.loop.run()
    assert bench.is_closed and bench.reports[-1].error == "unplugged"


def test_a_device_that_does_not_confirm_its_release_is_an_error():
    bench = Bench()
    bench.fails, bench.inputs = "close", [None]
    with pytest.raises(DeviceError, match="may still push"):
        bench.loop.run()


def test_a_device_that_cannot_start_is_an_error_of_the_device():
    bench = Bench()
    bench.fails = "raise"
    with pytest.raises(DeviceError, match="unplugged"):
        ForceLoop(bench, ForceRenderer(CAPABILITIES), bench.clock, bench, bench)


def test_it_reports_100_times_a_second_what_the_hand_felt():
    bench = Bench()
    bench.run_ms(1000)
    assert len(bench.reports) == 100
    samples = [sample for report in bench.reports for sample in report.samples]
    assert samples[-1].force_n[1] == pytest.approx(1.0) and samples[-1].is_engaged
    assert [sample.stamp_ns for sample in samples] == sorted({sample.stamp_ns for sample in samples})
    assert sum(len(report.late_ns) for report in bench.reports) == 1000
