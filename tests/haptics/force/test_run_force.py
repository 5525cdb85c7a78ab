"""A run with a force device: the hand steers and is pushed, and the recording has what it felt."""

from itertools import islice

import pytest
from helpers import MS
from ros_network import until

from haptigraph import run_force
from haptigraph.analysis.metrics.replay import replay
from haptigraph.assemble import build
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.haptics.force.interface import ForceCapabilities, HandReading
from haptigraph.recording.reader import RunReader
from haptigraph.robot.process import RobotProcess
from haptigraph.robot.simulated import EXAMPLE_SETUP
from haptigraph.run_force import force_devices_found, with_force
from haptigraph.run_robot import SteeredRobot
from haptigraph.teleop.teleop import Teleop

STEADY = "tests/data/steady.toml"
FORCED = "run.procedure=subretinal_injection_force"


class Sinking:
    """A hand that presses after 0.3 s, and goes down at 20 mm/s."""

    capabilities = ForceCapabilities(3.0, 1000.0, 250.0)

    def __init__(self, argument, clock):
        self.clock, self.began_ns = clock, clock.now_ns()

    def exchange(self, force_n):
        now_ns = self.clock.now_ns()
        held_s = max((now_ns - self.began_ns) / 1e9 - 0.3, 0.0)
        velocity_mm_s = (0.0, -20.0 if held_s else 0.0, 0.0)
        return HandReading(now_ns, (0.0, -20.0 * held_s, 0.0), velocity_mm_s, held_s > 0)

    def close(self):
        pass


@pytest.fixture
def sinking(monkeypatch):
    monkeypatch.setitem(run_force.FORCE_DEVICES, "sinking", f"{Sinking.__module__}:Sinking")
    return "sinking"


def test_a_run_records_the_force_and_a_replay_is_identical(tmp_path):
    path = tmp_path / "run.mcap"
    settings = (f"source.uri=phantom:{STEADY}", FORCED, "haptics.force=simulated", f"recording.path={path}")
    loop = build(load_config(None, settings))
    for _ in islice(loop.steps(), 60):
        pass
    loop.close()
    assert loop.report.is_silent and "cycles missed" in loop.report.force
    samples = [sample for capture, _ in RunReader(path).records(images=()) for sample in capture.force]
    assert len(samples) > 50
    assert [each.stamp_ns for each in samples] == sorted(each.stamp_ns for each in samples)
    stamps = [step.stamp_ns for _, step in RunReader(path).records(images=())]
    assert stamps[0] - 5000 * MS < samples[0].stamp_ns < stamps[-1]
    report = replay(path, None)
    assert report.identical == report.steps > 0


def test_the_hand_steers_what_it_feels():
    """Through the leader: the process is replaced by a source of samples."""
    from haptigraph.clock import MonotonicClock
    from haptigraph.haptics.force.hand import ForceHand
    from haptigraph.messages import ForceSample
    from haptigraph.teleop.leaders.steering import Steering

    hand, motions = ForceHand(MonotonicClock()), []
    steering = Steering("force", hand, motions.append).start()
    for number in range(50):
        hand.add(ForceSample(number, (0.0, -0.2 * number, 0.0), (0.0, 0.0, 0.0), number > 5))
    until(lambda: len(motions) >= 50, "no motion")
    assert sum(motion.along_mm for motion in motions) == pytest.approx(0.2 * 43)
    steering.close()


def test_a_steered_needle_moves_with_the_hand(sinking, monkeypatch):
    settings = ("source.uri=teleop:align_then_approach", FORCED, f"haptics.force={sinking}")
    moved = []
    monkeypatch.setattr(Teleop, "put", lambda self, motion: moved.append(motion))
    loop = build(load_config(None, settings))
    for _ in islice(loop.steps(), 600):
        if sum(motion.along_mm for motion in moved) > 5.0:
            break
    loop.close()
    assert sum(motion.along_mm for motion in moved) > 5.0
    assert not moved[0].engaged


def test_a_robot_that_a_page_steers_follows_the_hand_too(sinking, monkeypatch, tmp_path):
    """The page's enable switch still decides whether it moves."""
    from haptigraph.clock import MonotonicClock
    from haptigraph.sources.phantom import PhantomSource

    moved = []
    monkeypatch.setattr(RobotProcess, "__init__", lambda self, *arguments: None)
    process = RobotProcess()
    process._settings, process.put = load_settings(), moved.append
    config = load_config(None, (f"haptics.force={sinking}",))
    source = PhantomSource("align_then_approach")
    robot = SteeredRobot(process, EXAMPLE_SETUP, 0.0)
    force = with_force(config, Quiet(), source, robot, MonotonicClock())
    until(lambda: sum(motion.along_mm for motion in moved) > 1.0, "no motion")
    for leader in force.leaders:
        leader.close()
    force.output.close()


def load_settings():
    from haptigraph.teleop.motion import TeleopSettings

    return TeleopSettings()


class Quiet:
    is_silent = True

    def send(self, step, now_ns):
        pass

    def take_faults(self):
        return ()

    def close(self):
        pass


@pytest.mark.parametrize(
    "settings, sentence",
    [
        (("run.realtime=false",), "--force simulated works in real time"),
        (("run.leader=keys", "source.uri=teleop"), "leave out --leader keys"),
        (("haptics.force=simulatd",), "did you mean 'simulated'"),
        (("haptics.force=forcedimension:x",), "expected the device's number"),
    ],
)
def test_what_does_not_go_together_is_refused(settings, sentence, monkeypatch):
    from haptigraph.teleop.leaders import opening

    monkeypatch.setattr(opening, "steered", lambda *arguments: [])
    base = ("source.uri=phantom:align_then_approach", "haptics.force=simulated")
    with pytest.raises(BadInput, match=sentence):
        build(load_config(None, (*base, *settings)))


def test_every_kind_is_found_or_says_why_not():
    found = force_devices_found()
    assert {name.partition(":")[0] for name in found} == set(run_force.FORCE_DEVICES)
