"""`haptigraph`, but teleop:SCENARIO plays the scenario and delivers nothing after SIGUSR1, like a camera that hangs.

After SIGUSR2, the tracker no longer knows where the tip is. It replaces teleop because that, like a camera, is not read ahead.
"""

import signal
import threading

from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.cli import main
from haptigraph.clock import Clock
from haptigraph.messages import Capture, Observation
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.sources.phantom import PhantomSource

frozen, tipless = threading.Event(), threading.Event()
signal.signal(signal.SIGUSR2, lambda *_: tipless.set())
signal.signal(signal.SIGUSR1, lambda *_: frozen.set())


class FreezingSource(PhantomSource):
    def __init__(self, name: str, clock: Clock, target_mm: float | None = None) -> None:
        super().__init__(name, target_mm=target_mm)

    def read(self, timeout_s: float) -> Capture | None:
        if frozen.is_set():
            threading.Event().wait(timeout_s)
            return None
        return super().read(timeout_s)


class TiplessTracker(Tracker):
    def __call__(self, capture: Capture) -> Observation:
        observation = super().__call__(capture)
        if not tipless.is_set() or observation.certainty is None:
            return observation
        found = {name: shape for name, shape in observation.found.items() if name != "needle_tip"}
        return replace(observation, found=found, certainty=replace(observation.certainty, tip_sd_mm=None))


if __name__ == "__main__":
    assemble.SOURCES["teleop"] = "__main__:FreezingSource"
    assemble.PERCEIVERS["tracker"] = "__main__:TiplessTracker"
    main()
