"""Technical statistics of a run: counts, faults, and percentiles of the duration of every stage."""

import math
from collections import Counter
from collections.abc import Iterable

import numpy as np
from msgspec import Struct, field

from haptigraph.config import HapticsConfig
from haptigraph.display import ShownAsHtml
from haptigraph.haptics.observed_device import confirms
from haptigraph.messages import Delivered

__all__ = ["STAGES", "Durations", "RunReport"]

BINS, LOG_WIDTH = 2400, math.log(1.01)
STAGES = ("read", "perceive", "build_scene", "reason", "render", "step")


class Durations:
    """Percentiles of durations in constant memory: a histogram with 1 % wide bins, 100 ns to 1000 s."""

    def __init__(self) -> None:
        self._counts = [0] * BINS

    def add(self, duration_ns: int) -> None:
        """Count one duration."""
        index = int(math.log(duration_ns / 100) / LOG_WIDTH) if duration_ns > 100 else 0
        self._counts[index if index < BINS else -1] += 1

    def percentile_ms(self, percent: float) -> float:
        """Return a percentile [ms]; nan if nothing was counted."""
        total = sum(self._counts)
        if total == 0:
            return float("nan")
        index = int(np.searchsorted(np.cumsum(self._counts), total * percent / 100))
        return float(100 * 1.01 ** (index + 0.5) / 1e6)


class RunReport(Struct, ShownAsHtml):
    """Technical statistics of a run."""

    steps: int = 0
    duration_s: float = 0.0
    """On the run's clock, from the first to the last step."""
    wall_s: float = 0.0
    overruns: int = 0
    """Images that were due before the loop was ready for them."""
    slipped_s: float = 0.0
    """How much longer than its own time a source took because of them."""
    skipped: int = 0
    """Images of a live source that the loop was too slow to process."""
    dropped: int = 0
    """Items that sinks had to drop."""
    faults: Counter[str] = field(default_factory=Counter)
    """Number of occurrences of each fault."""
    stages: dict[str, Durations] = field(default_factory=lambda: {name: Durations() for name in STAGES})
    """Duration of reading an image, of each stage, and of the whole "step"."""
    ended: str = "source ended"
    """Why the run ended."""
    assumed: tuple[str, ...] = ()
    """What the registration assumes, by name."""
    is_output_off: bool = False
    """Whether the amplitude limit is 0, so that nothing can be felt."""
    confirmed_s: dict[str, float] = field(default_factory=dict)
    """How long each output confirmed that it vibrated; the outputs that confirm nothing are missing."""
    is_silent: bool = False
    """Whether the run is over, and the actuator raised no doubt that it is silent."""

    force: str = ""
    """How the force device ran, in one line; empty: there was none."""

    def __repr__(self) -> str:
        faults = f", faults: {self.faults.total()}" if self.faults else ""
        return f"<RunReport of {self.steps} steps, {self.rate_hz:.0f} steps/s{faults}; {self.ended}>"

    def note_limits(self, assumed: tuple[str, ...], haptics: HapticsConfig) -> None:
        """Note what the registration assumes, the limit of the amplitude, and whether the device confirms."""
        self.assumed, self.is_output_off = assumed, haptics.max_amplitude == 0
        self.confirmed_s = {haptics.device: 0.0} if confirms(haptics.device) else {}

    def add_late(self, late_ns: int) -> None:
        """Count an image that was late, and moves those after it."""
        self.overruns += 1
        self.slipped_s += late_ns / 1e9

    def add_confirmed(self, periods: Iterable[Delivered]) -> None:
        """Add periods for which an output confirmed that it vibrated."""
        for period in periods:
            before_s = self.confirmed_s.get(period.output, 0.0)
            self.confirmed_s[period.output] = before_s + (period.end_ns - period.start_ns) / 1e9

    @property
    def incomplete(self) -> str:
        """Why the recording is incomplete; empty if it is complete or there is none."""
        faults = (fault.removeprefix("recorder: ") for fault in self.faults if fault.startswith("recorder: "))
        return next((fault for fault in faults if " is incomplete (" in fault), "")

    @property
    def rate_hz(self) -> float:
        """Steps per second of wall-clock time."""
        return self.steps / self.wall_s if self.wall_s > 0 else 0.0
