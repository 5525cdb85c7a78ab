"""A robot in a process of its own, as the program that steers it sees it.

If this program dies, the process holds the robot and ends. If it hangs, it is to the process a leader that is
silent. If the process dies or hangs, no command is sent any more, and `status` says so.
"""

import math
import os
import threading
import time
from collections import deque

from haptigraph.child_process import program_of
from haptigraph.clock import lateness_ms
from haptigraph.errors import BadInput, DeviceError
from haptigraph.messages import HandState
from haptigraph.reporting_process import ReportingProcess
from haptigraph.robot.interface import RobotReading, StateCommand
from haptigraph.robot.messages import Input, MotionStatus, Report
from haptigraph.teleop.mapping import hand_state
from haptigraph.teleop.motion import HandMotion, TeleopSettings

__all__ = ["RobotProcess"]

PROGRAM = program_of("haptigraph.robot.loop")
START_S, CLOSE_S = 20.0, 2.0
SILENT_S = 0.25
"""Without a report for this time the process counts as hung."""
MAX_READINGS = 10_000
MAX_REPORTS = 250
ENDED, HUNG = "the robot's process has ended", "the robot's process does not respond"
LEFT = "it may keep to its last command: see that it stands still"


class RobotProcess:
    """Steer and observe one robot. It fits where a `Teleop` fits; any thread may call it. It starts disabled.

    Args:
        uri: The robot, as `open_robot` takes it.
        setup_path: Its robot.toml.
        settings: The initial settings; tremor is never added to a robot's motion.

    Raises:
        BadInput: If the setup is not valid, or the robot cannot be opened.
    """

    has_jaws = False

    def __init__(
        self, uri: str, setup_path: str | os.PathLike[str], settings: TeleopSettings | None = None
    ) -> None:
        self.uri = uri
        self._settings = settings or TeleopSettings()
        self._is_switched_on = self._is_closed = False
        self._lock = threading.Lock()
        self._arrived = threading.Condition()
        self._readings: deque[RobotReading] = deque(maxlen=MAX_READINGS)
        self._reports: deque[Report] = deque(maxlen=MAX_REPORTS)
        self._heard_s = math.inf
        command = [*PROGRAM, uri, os.fspath(setup_path)]
        self._process = ReportingProcess(command, Report, self._arrived, self._hear, "haptigraph-robot")
        self._await_open()
        self._send(Input(False, settings=self._settings))

    @property
    def settings(self) -> TeleopSettings:
        """How the hand's motion becomes the tool's; may be replaced at any time."""
        return self._settings

    @settings.setter
    def settings(self, settings: TeleopSettings) -> None:
        self._settings = settings
        self._send(Input(self._is_switched_on, settings=settings))

    @property
    def hand(self) -> HandState:
        """The state of the hand in the newest cycle that was reported."""
        return self._reports[-1].hand or hand_state(self._settings, engaged=False)

    def put(self, motion: HandMotion) -> None:
        """Pass one message of the hand on; lost if the process does not respond."""
        self._send(Input(self._is_switched_on, hand=motion))

    def set_enabled(self, on: bool) -> None:
        """Switch motion on or off. After an interruption it must be switched off, then on again."""
        self._is_switched_on = on
        self._send(Input(on))

    def request(self, command: StateCommand) -> None:
        """Ask the robot for another operating state; `status` has the reading that reports it."""
        self._send(Input(self._is_switched_on, request=command))

    def take_readings(self) -> list[RobotReading]:
        """Return the readings since the last call, oldest first, at most the newest 10,000."""
        with self._arrived:
            readings = list(self._readings)
            self._readings.clear()
        return readings

    @property
    def reading(self) -> RobotReading | None:
        """The newest reading; None before the first."""
        return self._reports[-1].reading

    def status(self) -> MotionStatus:
        """Return whether the robot moves, and if not, why."""
        with self._arrived:
            reports, heard_s = list(self._reports), self._heard_s
        newest, failure = reports[-1], ""
        if not self._process.is_running:
            failure = ENDED
        elif time.monotonic() - heard_s > SILENT_S:
            failure = HUNG
        late_ns = [late_ns for report in reports[1:] for late_ns in report.late_ns]
        p50_ms, p99_ms, p999_ms = lateness_ms(late_ns)
        span_ns = newest.stamp_ns - reports[0].stamp_ns
        return MotionStatus(
            is_moving=newest.is_moving and not failure,
            reasons=(failure,) if failure else newest.reasons,
            is_switched_on=self._is_switched_on,
            reading=newest.reading,
            rate_hz=0.0 if failure or not span_ns else len(late_ns) / (span_ns / 1e9),
            missed_deadlines=newest.missed_deadlines,
            late_p50_ms=p50_ms,
            late_p99_ms=p99_ms,
            late_p999_ms=p999_ms,
            error=newest.error,
        )

    def close(self) -> None:
        """Hold and release the robot, and end its process. May be called twice.

        Raises:
            DeviceError: If the process did not end by itself, or failed to hold the robot.
        """
        if self._is_closed:
            return
        self._is_closed = True
        code = self._process.end(CLOSE_S)
        if code is None:
            self._process.kill()
            raise DeviceError(f"{self.uri}: its process hung and was killed; {LEFT}")
        if code != 0:
            raise DeviceError(f"{self.uri}: its process had ended with {code}; {LEFT}")

    def _send(self, message: Input) -> None:
        with self._lock:
            self._process.send(message)

    def _await_open(self) -> None:
        with self._arrived:
            self._arrived.wait_for(lambda: self._reports or self._process.has_ended, START_S)
            newest = self._reports[-1] if self._reports else None
        if newest is None or (newest.hand is None and newest.error):
            self._is_closed = True
            self._process.kill()
            raise BadInput(newest.error if newest else f"{self.uri} does not open")

    def _hear(self, reports: list[Report]) -> None:
        """Take reports; called with the lock held."""
        for report in reports:
            self._readings.extend(report.readings)
        self._reports.extend(reports)
        self._heard_s = time.monotonic()
