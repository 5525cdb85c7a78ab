"""Listen to a robot during a run: its readings -> samples for the captures. Never commands anything."""

import threading
from collections import deque
from collections.abc import Callable
from contextlib import closing
from functools import lru_cache

import msgspec

from haptigraph.clock import Clock
from haptigraph.messages import Fault, RobotSample
from haptigraph.robot.interface import Robot, RobotReading
from haptigraph.robot.pose import Transform
from haptigraph.robot.setup import EyePlace, RobotSetup

__all__ = ["Listener", "faults_of", "sample_of"]

PERIOD_S = 0.002  # between readings: twice as often as a robot at 250 Hz reports
MAX_SAMPLES = 5000  # between two captures; more would be a robot beyond 1 kHz and a stalled run
NS_PER_MS = 1e6


def sample_of(reading: RobotReading, setup: RobotSetup | None, latency_ms: float = 0.0) -> RobotSample | None:
    """Return a reading as the sample of a run; None if it has no valid pose.

    Args:
        reading: The reading.
        setup: Where the eye is; None: the tip in the eye frame stays unknown.
        latency_ms: How much later than measured the robot stamps its poses.
    """
    pose = reading.pose
    if pose is None or not pose.is_finite:
        return None
    eye = setup.eye if setup else None
    eye_tip = _eye_from_robot(eye).point_mm(pose.position_mm).tolist() if eye else None
    return RobotSample(
        reading.stamp_ns - round(latency_ms * NS_PER_MS),
        pose.position_mm,
        pose.quaternion,
        operating=reading.operating.state if reading.operating else "",
        force_n=reading.force_n,
        eye_tip_mm=msgspec.convert(eye_tip, tuple[float, float, float]) if eye_tip else None,
        eye_tip_sd_mm=eye.tip_sd_mm if eye else None,
    )


@lru_cache
def _eye_from_robot(eye: EyePlace) -> Transform:
    return eye.robot_from_eye.inverse()


def faults_of(reading: RobotReading, known: int) -> list[Fault]:
    """Return the problems of a reading as faults of a run, without the first ones, which are known."""
    return [Fault("robot", problem) for problem in reading.problems[known:]]


class Listener:
    """Collect a robot's samples in a thread of its own, until a run takes them.

    Args:
        open_robot: Opens it, in that thread: a robot is used by one thread only.
        clock: The run's.
        setup: Where the eye is; None: unknown.
        latency_ms: How much later than measured the robot stamps its poses.

    Raises:
        BadInput: If the robot cannot be opened.
    """

    def __init__(
        self,
        open_robot: Callable[[Clock], Robot],
        clock: Clock,
        setup: RobotSetup | None,
        latency_ms: float = 0.0,
    ) -> None:
        self._setup, self._latency_ms = setup, latency_ms
        self._samples: deque[RobotSample] = deque(maxlen=MAX_SAMPLES)
        self._faults: deque[Fault] = deque()
        self._stopped, self._opened = threading.Event(), threading.Event()
        self._failure: BaseException | None = None
        self._thread = threading.Thread(
            target=self._listen, args=(open_robot, clock), name="robot listener", daemon=True
        )
        self._thread.start()
        self._opened.wait()
        if self._failure is not None:
            raise self._failure

    def take(self) -> tuple[RobotSample, ...]:
        """Return the samples since the last call, oldest first."""
        samples = list[RobotSample]()
        while self._samples:
            samples.append(self._samples.popleft())
        return tuple(samples)

    def take_faults(self) -> tuple[Fault, ...]:
        """Return what was wrong with the robot's messages since the last call."""
        return tuple(self._faults.popleft() for _ in range(len(self._faults)))

    def close(self) -> None:
        """Disconnect. May be called twice."""
        self._stopped.set()
        self._thread.join()

    def _listen(self, open_robot: Callable[[Clock], Robot], clock: Clock) -> None:
        try:
            robot = open_robot(clock)
        except BaseException as error:  # raised where the listener was made
            self._failure = error
            return
        finally:
            self._opened.set()
        with closing(robot):
            number = known = 0
            while not self._stopped.wait(PERIOD_S):
                reading = robot.read()
                self._faults += faults_of(reading, known)
                known = len(reading.problems)
                if reading.number == number:
                    continue
                number = reading.number
                if (sample := sample_of(reading, self._setup, self._latency_ms)) is not None:
                    self._samples.append(sample)
