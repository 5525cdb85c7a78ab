"""Summarise a run once a second as ROS diagnostics: health of the loop, rates, faults."""

from collections import Counter

from haptigraph.messages import Capture, Step
from haptigraph.ros2.types import DiagnosticArray, DiagnosticStatus, Header, KeyValue, Time

__all__ = ["ERROR", "OK", "STALE", "WARN", "RunDiagnostics", "diagnostic_status"]

OK, WARN, ERROR, STALE = range(4)
"""Levels of a status in ROS."""
PERIOD_NS = 1_000_000_000


class RunDiagnostics:
    """Collect steps and summarise them once a second.

    Args:
        name: Of the component in the diagnostics.
        utc_offset_ns: Nanoseconds since 1970 minus stamp_ns.
    """

    def __init__(self, name: str, utc_offset_ns: int) -> None:
        self._name, self._utc_offset_ns = name, utc_offset_ns
        self._begun_ns: int | None = None
        self._steps = self._images = self._latency_ns = 0
        self._faults: Counter[str] = Counter()

    def add(self, capture: Capture, step: Step) -> DiagnosticArray | None:
        """Add one step; return the summary if it completes a second."""
        if self._begun_ns is None:
            self._begun_ns = step.stamp_ns
        elapsed_ns = step.stamp_ns - self._begun_ns
        self._steps += 1
        self._images += capture.image is not None
        if step.timing is not None:
            self._latency_ns = max(self._latency_ns, step.timing.commanded_ns - step.stamp_ns)
        self._faults.update(map(str, step.faults))
        if elapsed_ns < PERIOD_NS:
            return None
        summary = self._summary(step, elapsed_ns)
        self._begun_ns, self._steps, self._images, self._latency_ns = step.stamp_ns, 0, 0, 0
        self._faults.clear()
        return summary

    def _summary(self, step: Step, elapsed_ns: int) -> DiagnosticArray:
        level, message = OK, "ok"
        if self._faults:
            level, message = WARN, self._faults.most_common(1)[0][0]
        if not self._images:
            level = ERROR
        values = {
            "state": step.conclusion.state,
            "image_rate_hz": f"{self._images * 1e9 / elapsed_ns:.1f}",
            "step_rate_hz": f"{self._steps * 1e9 / elapsed_ns:.1f}",
            "longest_latency_ms": f"{self._latency_ns / 1e6:.1f}",
            **{f"fault {number}": f"{text} ({count} times)" for number, (text, count) in self._ranked()},
        }
        status = diagnostic_status(self._name, "loop", level, message, values)
        return DiagnosticArray(Header(Time.from_ns(step.stamp_ns + self._utc_offset_ns)), [status])

    def _ranked(self) -> list[tuple[int, tuple[str, int]]]:
        return list(enumerate(self._faults.most_common(5), 1))


def diagnostic_status(
    component: str, part: str, level: int, message: str, values: dict[str, str]
) -> DiagnosticStatus:
    """Return the status of one part of a component."""
    pairs = [KeyValue(key, value) for key, value in values.items()]
    return DiagnosticStatus(level, f"{component}: {part}", message, component, pairs)
