"""The newest valid pose among received messages. Others are rejected, reported once, and never used."""

import threading
import time
from collections.abc import Callable, Hashable

from msgspec.structs import replace

from haptigraph.clock import Clock
from haptigraph.robot.interface import RobotReading
from haptigraph.robot.pose import ToolPose
from haptigraph.robot.ros.stamps import StampClock

__all__ = ["PoseInput"]

ALONE_NS = 500_000_000  # so long after the last message of one publisher, another may take over
MAX_PROBLEMS = 20


class PoseInput:
    """Poses of one robot, put by threads that receive and read by the one that moves.

    Args:
        name: Of the robot, in reports.
        clock: The run's.
        utc_ns: Returns UTC of this machine [ns].
    """

    def __init__(self, name: str, clock: Clock, utc_ns: Callable[[], int] = time.time_ns) -> None:
        self._name, self._clock, self._utc_ns = name, clock, utc_ns
        self._stamps = StampClock(clock, utc_ns)
        self._lock = threading.Lock()
        self._reading = RobotReading(0, 0)
        self._frame_id: str | None = None
        self._publisher: Hashable = None
        self._published_ns = self._rival_ns = -ALONE_NS
        self._reported: set[str] = set()
        self._problems: list[str] = []

    @property
    def frame_id(self) -> str:
        """The frame of the poses; empty before the first."""
        return self._frame_id or ""

    def put(self, pose: ToolPose, stamp_ns: int, frame_id: str, publisher: Hashable) -> None:
        """Take a pose.

        Args:
            pose: Valid.
            stamp_ns: UTC of the robot's machine [ns]; 0: none.
            frame_id: Its frame of reference.
            publisher: Identifies who sent it.

        Raises:
            ValueError: If its frame differs from that of the first, it is older than the previous one, or two
                publishers send at a time.
        """
        now_ns = self._clock.now_ns()
        with self._lock:
            self._check_publisher(publisher, now_ns)
            if self._frame_id is None:
                self._frame_id = frame_id
            if frame_id != self._frame_id:
                raise ValueError(f"a pose in frame {frame_id!r}; the first was in {self._frame_id!r}")
            converted_ns = self._stamps.to_run_clock(stamp_ns, now_ns)
            self._reading = RobotReading(converted_ns, now_ns, pose, number=self._reading.number + 1)
        if self._stamps.note:
            self.report("stamps", self._stamps.note)

    def reject(self, problem: str) -> None:
        """Report a message that was rejected; a problem of the same kind is reported once."""
        kind = "".join(letter for letter in problem if letter.isalpha())
        self.report(kind, f"rejected {problem}")

    def report(self, kind: str, sentence: str) -> None:
        """Report a sentence, once for its kind."""
        with self._lock:
            if kind not in self._reported and len(self._problems) < MAX_PROBLEMS:
                self._reported.add(kind)
                self._problems.append(f"{self._name}: {sentence}")

    def read(self) -> RobotReading:
        """Return the newest pose, and the problems so far."""
        with self._lock:
            return replace(self._reading, problems=tuple(self._problems))

    def _check_publisher(self, publisher: Hashable, now_ns: int) -> None:
        """Accept one publisher at a time: of two, nobody knows which one is the robot."""
        if publisher != self._publisher:
            if now_ns - self._published_ns <= ALONE_NS:
                self._rival_ns = now_ns
            else:  # the first, or a robot that was started again
                self._publisher = publisher
                self._stamps = StampClock(self._clock, self._utc_ns)
        if publisher == self._publisher:
            self._published_ns = now_ns
        if now_ns - self._rival_ns <= ALONE_NS:
            raise ValueError("poses of two publishers at a time; stop one of them")
