"""A force device in a process of its own, as the run sees it.

If the run dies or hangs, the process lets go of the hand. If the process dies, hangs or reports that the
device failed, the run kills it, and a second process, which waits in reserve, opens the device: opening it
lets go. Force then begins anew, from zero.
"""

import threading
from collections import deque
from collections.abc import Callable

from haptigraph.clock import lateness_ms
from haptigraph.errors import BadInput, DeviceError
from haptigraph.haptics.force.child import Child
from haptigraph.haptics.force.interface import ForceCapabilities
from haptigraph.haptics.force.messages import ForceInput, ForceReport, ForceStatus
from haptigraph.messages import ForceSample

__all__ = ["ForceProcess"]

START_S, CLOSE_S, RETRY_S = 20.0, 2.0, 2.0
TICK_S = 0.025
SILENT_TICKS = 4  # without a report, before the process counts as hung
MAX_SAMPLES = 10_000
MAX_PROBLEMS = 100
MAX_REPORTS = 500
ENDED, HUNG = "its process has ended", "its process does not respond"


class ForceProcess:
    """Let a device push the hand by the fixtures of the newest step, and return what it did.

    Args:
        name: Of the device, for messages.
        device: "module:Class" of the device.
        argument: The argument of the class.
        deadman_ms: Without fixtures for this time, the hand is let go.
        listener: Called with every sample, at once.

    Raises:
        BadInput: If the device cannot be opened.
    """

    def __init__(
        self,
        name: str,
        device: str,
        argument: str,
        deadman_ms: float,
        listener: Callable[[ForceSample], None] = lambda sample: None,
    ) -> None:
        self.name = name
        self._listener = listener
        self._arguments = [device, argument, f"{deadman_ms:g}"]
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._samples: deque[ForceSample] = deque(maxlen=MAX_SAMPLES)
        self._problems: deque[str] = deque(maxlen=MAX_PROBLEMS)
        self._reports: deque[ForceReport] = deque(maxlen=MAX_REPORTS)
        self._releases = 0
        self._has_let_go = self._is_closed = False
        self._active, self._reserve = self._started(), self._started()
        self._active.go()
        self.capabilities = self._await_open()
        self._supervision = threading.Thread(target=self._supervise, name="haptigraph-force", daemon=True)
        self._supervision.start()

    @property
    def has_let_go(self) -> bool:
        """Whether it is closed, and the device confirmed that it does not push any more."""
        return self._is_closed and self._has_let_go

    def send(self, message: ForceInput) -> None:
        """Pass the fixtures of a step on; lost if the process does not respond."""
        self._active.send(message)

    def take(self) -> tuple[ForceSample, ...]:
        """Return what the device did since the last call, oldest first."""
        return tuple(self._samples.popleft() for _ in range(len(self._samples)))

    def take_problems(self) -> tuple[str, ...]:
        """Return why force was released since the last call, a sentence each."""
        return tuple(self._problems.popleft() for _ in range(len(self._problems)))

    def status(self) -> ForceStatus:
        """Return how the loop runs."""
        with self._changed:
            reports = list(self._reports)
        late_ns = [late_ns for report in reports[1:] for late_ns in report.late_ns]
        span_ns = reports[-1].stamp_ns - reports[0].stamp_ns if reports else 0
        p50_ms, p99_ms, p999_ms = lateness_ms(late_ns)
        missed = max((report.missed for report in reports), default=0)
        rate_hz = len(late_ns) / (span_ns / 1e9) if span_ns else 0.0
        return ForceStatus(rate_hz, missed, p50_ms, p99_ms, p999_ms, self._releases)

    def summary(self) -> str:
        """Return how the loop ran, in one line."""
        status = self.status()
        return (
            f"{status.rate_hz:.0f} Hz, late {status.late_p50_ms:.2f} (p50), {status.late_p99_ms:.2f} (p99), "
            f"{status.late_p999_ms:.2f} ms (p99.9), {status.missed} cycles missed, released "
            f"{status.releases} times by a problem"
        )

    def close(self) -> None:
        """Let go of the hand, and end the process. May be called twice.

        Raises:
            DeviceError: If the device did not confirm that it let go.
        """
        if self._is_closed:
            return
        self._closing.set()
        self._supervision.join()
        try:
            if not self._confirms(self._active, CLOSE_S):
                self._active.kill()
                self._reserve.go()
                self._confirms(self._reserve, START_S)
        finally:
            for child in (self._active, self._reserve):
                child.kill()
        self._is_closed = True  # not if Ctrl-C interrupted it
        if not self._has_let_go:
            raise DeviceError(f"{self.name} does not confirm that it let go; it may still push")

    def _started(self) -> Child:
        return Child(self._arguments, self._changed, self._hear)

    def _confirms(self, child: Child, within_s: float) -> bool:
        """End a process; return whether the device has let go: confirmed by this process or the last one."""
        code = child.end(within_s)
        if code == 0 or child.capabilities is not None:
            self._has_let_go = code == 0
        return self._has_let_go

    def _await_open(self) -> ForceCapabilities:
        with self._changed:
            self._changed.wait_for(lambda: self._active.capabilities or self._active.has_ended, START_S)
        if self._active.capabilities is None:
            for child in (self._active, self._reserve):
                child.kill()
            raise BadInput(self._active.error or f"{self.name} does not open")
        return self._active.capabilities

    def _hear(self, report: ForceReport) -> None:
        """Take a report; called with the lock held."""
        for sample in report.samples:
            self._samples.append(sample)
            self._listener(sample)
        self._reports.append(report)
        for problem in report.problems:
            self._note(problem)

    def _note(self, problem: str) -> None:
        self._releases += 1
        self._problems.append(f"{self.name}: {problem}")

    def _supervise(self) -> None:
        """Replace the process when it has ended or hangs."""
        ticks = 0
        while not self._closing.is_set():
            child = self._active
            with self._changed:
                is_silent = not child.has_ended and not self._changed.wait(TICK_S)
            ticks = ticks + 1 if is_silent else 0
            limit_ticks = START_S / TICK_S if child.capabilities is None else SILENT_TICKS
            if child.has_ended or ticks > limit_ticks:
                self._replace(child.error or ENDED if child.has_ended else HUNG)
                ticks = 0

    def _replace(self, problem: str) -> None:
        """Let the process in reserve open the device, and start another reserve."""
        failed = self._active
        if failed.capabilities is not None:
            self._has_let_go = failed.has_ended and failed.end(CLOSE_S) == 0
            self._note(problem)
        failed.kill()
        if failed.capabilities is None and self._closing.wait(RETRY_S):
            return
        try:
            if self._reserve is failed:  # none could be started last time
                self._reserve = self._started()
            self._active = self._reserve
            self._active.go()
            self._reserve = self._started()
        except OSError as error:
            self._note(f"no process can be started in reserve ({error.strerror})")
            self._closing.wait(RETRY_S)
