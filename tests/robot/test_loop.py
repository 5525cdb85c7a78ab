import pytest

from haptigraph.clock import VirtualClock
from haptigraph.errors import BadInput, DeviceError
from haptigraph.robot.controller import Controller
from haptigraph.robot.gate import HOLDS
from haptigraph.robot.interface import Robot
from haptigraph.robot.loop import PERIOD_NS, RobotLoop
from haptigraph.robot.messages import Input, Report
from haptigraph.robot.opening import open_robot
from haptigraph.robot.process import RobotProcess
from haptigraph.robot.simulated import EXAMPLE_SETUP, SimulatedRobot
from haptigraph.teleop.motion import HandMotion, TeleopSettings

MS = 1_000_000


class Bench:
    """The loop on a virtual clock; `script` has the messages of coming cycles."""

    def __init__(self, robot: type[SimulatedRobot] = SimulatedRobot) -> None:
        self.clock = VirtualClock(10 * MS)
        self.robot = robot("2", self.clock)
        controller = Controller(EXAMPLE_SETUP, is_checked=True)
        self.loop = RobotLoop(self.robot, controller, self.clock, self, self)
        self.script: list[list[Input] | None] = []
        self.reports: list[Report] = []
        self.is_on = False

    def take(self):
        return self.script.pop(0) if self.script else [Input(self.is_on, HandMotion(True, 0.05))]

    def send(self, report: Report) -> None:
        self.reports.append(report)

    def cycles(self, count: int) -> Report:
        for _ in range(count):
            assert self.loop.cycle()
        return self.reports[-1]

    def start(self) -> Report:
        self.script.append([Input(False, request="enable"), Input(False, request="home")])
        self.cycles(140)
        self.is_on = True
        return self.cycles(40)


def test_it_moves_the_robot_when_switched_on_and_reports_each_reading_once():
    bench = Bench()
    assert bench.start().is_moving
    numbers = [reading.number for report in bench.reports for reading in report.readings]
    assert len(numbers) == len(set(numbers)) > 120
    assert min(numbers) == 1
    assert sum(len(report.late_ns) for report in bench.reports) in range(176, 181)


@pytest.mark.parametrize("inputs", [[Input(True), Input(False), Input(True)], [Input(False)]])
def test_a_switch_that_was_off_within_a_cycle_is_off_in_it(inputs):
    bench = Bench()
    bench.start()
    bench.script = [inputs]
    assert bench.cycles(1).reasons[0] == HOLDS["is_switched_on"]
    assert bench.cycles(40).is_moving


def test_a_stall_is_counted_and_holds_until_switched_off_and_on():
    bench = Bench()
    bench.start()
    bench.clock.wait_until(bench.clock.now_ns() + 20 * PERIOD_NS)
    report = bench.cycles(1)
    assert not report.is_moving and HOLDS["is_on_time"] in report.reasons
    assert report.missed_deadlines == 19
    assert not bench.cycles(100).is_moving
    bench.script = [[Input(False)]]
    assert bench.cycles(40).is_moving


def test_a_short_delay_is_counted_and_does_not_interrupt():
    bench = Bench()
    bench.start()
    bench.clock.wait_until(bench.clock.now_ns() + 4 * PERIOD_NS)
    report = bench.cycles(4)
    assert report.is_moving and report.missed_deadlines == 3


class SlowRobot(SimulatedRobot):
    """Takes 30 ms to read when it is slow."""

    is_slow = False
    moves = 0

    def read(self):
        if self.is_slow:
            self._clock.wait_until(self._clock.now_ns() + 30 * MS)
        return super().read()

    def move(self, pose, stamp_ns):
        self.moves += 1
        super().move(pose, stamp_ns)


def test_a_command_that_took_too_long_to_compute_is_not_sent():
    bench = Bench(SlowRobot)
    bench.start()
    count, bench.robot.is_slow = bench.robot.moves, True
    assert bench.cycles(1).reasons == ("a cycle took too long",)
    assert bench.robot.moves == count > 0
    bench.robot.is_slow = False
    assert not bench.cycles(50).is_moving


class BrokenRobot(SimulatedRobot):
    """Its connection fails; it counts the commands to hold."""

    is_broken = False
    holds = 0

    def move(self, pose, stamp_ns):
        if self.is_broken:
            raise DeviceError("no network")
        super().move(pose, stamp_ns)

    def hold(self, stamp_ns):
        self.holds += 1
        super().hold(stamp_ns)


def test_a_failure_holds_the_robot_is_reported_and_does_not_end_the_loop():
    bench = Bench(BrokenRobot)
    bench.start()
    count, bench.robot.is_broken = bench.robot.holds, True
    assert bench.cycles(1).reasons == ("DeviceError: no network",)
    assert bench.robot.holds == count + 1
    bench.robot.is_broken = False
    report = bench.cycles(20)
    assert not report.is_moving and report.error == "DeviceError: no network"


def test_at_the_end_of_its_input_it_closes_the_robot():
    bench = Bench(BrokenRobot)
    bench.script = [[], None]
    bench.loop.run()
    assert bench.robot.holds == 2  # of the cycle, and when it was closed


def test_settings_apply_from_the_next_cycle():
    bench = Bench()
    bench.start()
    bench.script = [[Input(True, settings=TeleopSettings(motion_scale=0.0))]]
    bench.cycles(1)
    held_at = [bench.cycles(8).hand.asked_along_mm for _ in range(2)]
    assert held_at == [0.0, 0.0]


# --- robots


def test_the_simulated_robot_is_a_robot_with_operating_states():
    clock = VirtualClock(0)
    robot = open_robot("simulated:4", clock)
    assert isinstance(robot, Robot)

    def after_ms(duration_ms):
        clock.wait_until(clock.now_ns() + duration_ms * MS)
        return robot.read().operating

    assert (after_ms(0).state, after_ms(0).is_homed) == ("DISABLED", False)
    for command, state in [("pause", "DISABLED"), ("enable", "ENABLED"), ("pause", "PAUSED"), ("home", "PAUSED"),
                           ("resume", "ENABLED"), ("home", "ENABLED")]:  # fmt: skip
        robot.request(command)
        assert after_ms(10).state == state
    assert after_ms(0).is_busy and not after_ms(0).is_homed
    assert after_ms(600).is_homed and not after_ms(0).is_busy
    robot.request("disable")
    assert after_ms(0).state == "DISABLED"


@pytest.mark.parametrize("argument", ["x", "-1", "1?seed=2", "1?setup="])
def test_an_invalid_simulated_robot_is_refused(argument):
    with pytest.raises(BadInput, match="valid: simulated"):
        open_robot(f"simulated:{argument}", VirtualClock(0))


def test_a_robot_that_cannot_be_opened_is_refused_by_its_process(tmp_path):
    setup = tmp_path / "robot.toml"
    setup.write_text("[rcm]\nat_mm = [0.0, 0.0, 0.0]\n")
    with pytest.raises(BadInput, match=r"no \[eye\]"):
        RobotProcess("simulated", setup)
