"""The real program with a force device whose forces are logged, and which fails on command.

python forced_run.py run ...    as `haptigraph run ...`; --force traced:FOLDER

The device logs every force in FOLDER/forces. It fails as the content of FOLDER/fault says: raise, nan, freeze,
jump, speed, hang, or disconnect.
"""

import math
import os
import sys
import time
from pathlib import Path

from haptigraph.cli import main
from haptigraph.clock import Clock
from haptigraph.errors import BadInput, DeviceError
from haptigraph.haptics.force.interface import ForceCapabilities, HandReading
from haptigraph.robot.pose import Vec3

PRESS_NS = 200_000_000
ZERO: Vec3 = (0.0, 0.0, 0.0)


class TracedForce:
    """A hand that does not move, and holds the clutch from 0.2 s after the start."""

    capabilities = ForceCapabilities(3.0, 1000.0, 500.0)

    def __init__(self, argument: str, clock: Clock) -> None:
        self._clock, self._folder = clock, Path(argument)
        self._log = os.open(self._folder / "forces", os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        self._began_ns, self._fault, self._reading = clock.now_ns(), "", None
        self._is_closed = False
        if self._read_fault() == "disconnect":
            raise BadInput("is not connected", "traced")

    def exchange(self, force_n: Vec3) -> HandReading:
        fault = self._read_fault()
        if fault != self._fault:
            self._fault = fault
            self._note(f"fault {fault}")
        if fault in ("raise", "disconnect"):
            raise (DeviceError if fault == "disconnect" else RuntimeError)("it failed")
        if fault == "hang":
            (self._folder / "fault").unlink()  # the process that comes next works
            time.sleep(3600)
        self._note(f"force {math.hypot(*force_n)}")
        now_ns = self._clock.now_ns()
        if fault == "freeze" and self._reading is not None:
            return self._reading
        position_mm = {"nan": (math.nan, 0.0, 0.0), "jump": (0.0, 40.0, 0.0)}.get(fault, ZERO)
        velocity_mm_s = (0.0, 2000.0, 0.0) if fault == "speed" else ZERO
        is_held = now_ns - self._began_ns > PRESS_NS
        self._reading = HandReading(now_ns, position_mm, velocity_mm_s, is_held)
        return self._reading

    def close(self) -> None:
        if self._fault == "disconnect":
            raise DeviceError("is not connected")
        if not self._is_closed:
            self._is_closed = True
            self._note("force 0.0")
            self._note("closed")

    def _note(self, text: str) -> None:
        os.write(self._log, f"{time.monotonic_ns()} {os.getpid()} {text}\n".encode())

    def _read_fault(self) -> str:
        try:
            return (self._folder / "fault").read_text()
        except OSError:
            return ""


if __name__ == "__main__":
    from haptigraph import run_force

    run_force.FORCE_DEVICES["traced"] = "forced_run:TracedForce"
    sys.exit(main(sys.argv[1:]))
