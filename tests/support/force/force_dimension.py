"""A stand-in for `forcedimension_core.dhd` 1.0: the functions that are used, with their documented signatures.

Axes of the device: x towards the operator, y right, z up; metres and newtons. Each function returns 0 or a
positive code if it succeeds, -1 if not.
"""

import sys
import types
from contextlib import contextmanager

MOTOR_SATURATED = 2


class Dhd(types.ModuleType):
    """The binding with one device; its fields may be changed at any time."""

    def __init__(self):
        super().__init__("forcedimension_core.dhd")
        self.expert = self.Expert(self)
        self.calls, self.fails = [], ()
        self.position_m, self.velocity_m_s, self.button = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0
        self.count = 1

    class Expert(types.ModuleType):
        def __init__(self, dhd):
            super().__init__("forcedimension_core.dhd.expert")
            self.dhd = dhd

        def enableExpertMode(self) -> int:
            return self.dhd.did("enableExpertMode")

        def disableExpertMode(self) -> int:
            return self.dhd.did("disableExpertMode")

        def setWatchdog(self, duration: int, ID: int = -1) -> int:
            return self.dhd.did("setWatchdog", duration)

    def did(self, name, *values):
        self.calls.append((name, *values))
        return -1 if name in self.fails else 0

    def errorGetLastStr(self) -> str:
        return "device timed out"

    def getDeviceCount(self) -> int:
        return self.count

    def openID(self, index: int) -> int:
        return self.did("openID", index) or (0 if index < self.count else -1)

    def close(self, ID: int = -1) -> int:
        return self.did("close")

    def stop(self, ID: int = -1) -> int:
        return self.did("stop")

    def setForce(self, f, ID: int = -1) -> int:
        return self.did("setForce", *f) or MOTOR_SATURATED

    def setMaxForce(self, limit: float, ID: int = -1) -> int:
        return self.did("setMaxForce", limit)

    def getPosition(self, out, ID: int = -1) -> int:
        out[:] = self.position_m
        return self.did("getPosition")

    def getLinearVelocity(self, out, ID: int = -1) -> int:
        out[:] = self.velocity_m_s
        return self.did("getLinearVelocity")

    def getButton(self, index: int, ID: int = -1) -> int:
        return self.did("getButton") or self.button


@contextmanager
def installed():
    """Let the stand-in be imported as the binding."""
    dhd = Dhd()
    package = types.ModuleType("forcedimension_core")
    package.dhd = dhd
    before = {name: sys.modules.get(name) for name in ("forcedimension_core", "forcedimension_core.dhd")}
    sys.modules.update({"forcedimension_core": package, "forcedimension_core.dhd": dhd})
    try:
        yield dhd
    finally:
        for name, module in before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module
