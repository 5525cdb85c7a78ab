"""One process that runs the loop of a force device; it opens the device on command."""

import threading
from collections.abc import Callable, Sequence

from haptigraph.child_process import program_of
from haptigraph.haptics.force.interface import ForceCapabilities
from haptigraph.haptics.force.messages import ForceReport
from haptigraph.reporting_process import ReportingProcess

__all__ = ["Child"]

PROGRAM = program_of("haptigraph.haptics.force.loop")


class Child(ReportingProcess[ForceReport]):
    """Start the process. It exits with 0 if the device let go.

    Args:
        arguments: Of the program.
        changed: Notified, and held, whenever reports arrive or the process ends.
        hear: Called with every report.

    Raises:
        OSError: If it cannot be started.
    """

    def __init__(
        self, arguments: Sequence[str], changed: threading.Condition, hear: Callable[[ForceReport], None]
    ) -> None:
        self.capabilities: ForceCapabilities | None = None
        """Of the device; None: it is not open."""
        self.error = ""
        """Why the device cannot be opened, or failed."""
        self._hear_one = hear
        super().__init__([*PROGRAM, *arguments], ForceReport, changed, self._take, "haptigraph-force")

    def go(self) -> None:
        """Let it open the device."""
        self.write(b"g")

    def _take(self, reports: list[ForceReport]) -> None:
        for report in reports:
            self.capabilities = report.capabilities or self.capabilities
            self.error = report.error or self.error
            self._hear_one(report)
