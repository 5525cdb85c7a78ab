"""`haptigraph`, but teleop:SCENARIO plays the scenario and delivers nothing after SIGUSR1, like a camera that hangs.

It replaces teleop because that, like a camera, is not read ahead.
"""

import signal
import threading

from haptigraph import assemble
from haptigraph.cli import main
from haptigraph.clock import Clock
from haptigraph.messages import Capture
from haptigraph.sources.phantom import PhantomSource

frozen = threading.Event()
signal.signal(signal.SIGUSR1, lambda *_: frozen.set())


class FreezingSource(PhantomSource):
    def __init__(self, name: str, clock: Clock, target_mm: float | None = None) -> None:
        super().__init__(name, target_mm=target_mm)

    def read(self, timeout_s: float) -> Capture | None:
        if frozen.is_set():
            threading.Event().wait(timeout_s)
            return None
        return super().read(timeout_s)


if __name__ == "__main__":
    assemble.SOURCES["teleop"] = "__main__:FreezingSource"
    main()
