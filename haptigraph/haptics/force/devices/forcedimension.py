"""A haptic device of Force Dimension (omega, delta, sigma, lambda) or a Falcon, through its SDK.

The public Python binding `forcedimension-core` calls the SDK, which Force Dimension distributes. The clutch
is the button of the handle. The axes of these devices are x towards the operator, y right, z up.
"""

from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from typing import Any

from msgspec.structs import replace

from haptigraph.clock import Clock
from haptigraph.errors import BadInput, DeviceError, MissingExtra
from haptigraph.haptics.force.interface import ForceCapabilities, HandReading
from haptigraph.robot.pose import Vec3

__all__ = ["ForceDimension"]

LIMIT_N, LIMIT_MM_S = 3.0, 250.0
WATCHDOG_MS = 20.0
TICKS_PER_MS = 8  # of the device's own watchdog
BUTTON = 0
NO_SDK = (
    "the Force Dimension SDK, 3.16 or later, is not installed, or cannot be loaded; install it from "
    "https://www.forcedimension.com/software/sdk"
)


class ForceDimension:
    """Push the hand at one device.

    Args:
        argument: Its number, from 0; empty: the first one.
        clock: Stamps the readings.

    Raises:
        BadInput: If there is no such device, or the SDK is not installed.
        MissingExtra: If the binding is not installed.
    """

    capabilities = ForceCapabilities(
        max_force_n=LIMIT_N,
        rate_hz=1000.0,
        max_speed_mm_s=LIMIT_MM_S,
        limitations="Never tried on hardware. Calibrate the device first; its force button must be on.",
    )

    def __init__(self, argument: str, clock: Clock) -> None:
        number = argument or "0"
        if not number.isdecimal():
            raise BadInput(f"found {argument!r}; expected the device's number, from 0", "forcedimension")
        self._dhd, self._clock = _binding(), clock
        self._is_closed = False
        self._id = self._dhd.openID(int(number))
        if self._id < 0:
            raise BadInput(f"it cannot be opened ({self._dhd.errorGetLastStr()})", f"forcedimension:{number}")
        self._name = f"forcedimension:{number}"
        self._position_m, self._velocity_m_s = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        try:
            self._check(self._dhd.setForce([0.0, 0.0, 0.0], self._id))
            self.capabilities = self._with_watchdog()
            self._check(self._dhd.setMaxForce(LIMIT_N, self._id))
        except DeviceError as error:
            self._dhd.close(self._id)
            raise BadInput(str(error), self._name) from None

    @staticmethod
    def found() -> dict[str, str]:
        """Return the devices that are connected: the argument of each, and what it is."""
        return {f"forcedimension:{each}": "connected" for each in range(max(_binding().getDeviceCount(), 0))}

    def exchange(self, force_n: Vec3) -> HandReading:
        """Set the force, and return position and velocity.

        Raises:
            DeviceError: If the SDK reports an error.
        """
        right_n, up_n, towards_n = force_n
        self._check(self._dhd.setForce([towards_n, right_n, up_n], self._id))
        self._check(self._dhd.getPosition(self._position_m, self._id))
        self._check(self._dhd.getLinearVelocity(self._velocity_m_s, self._id))
        button = self._dhd.getButton(BUTTON, self._id)
        self._check(button)
        return HandReading(
            self._clock.now_ns(), _ours_mm(self._position_m), _ours_mm(self._velocity_m_s), button == 1
        )

    def close(self) -> None:
        """Set the force to zero, brake, and release the device. May be called twice.

        Raises:
            DeviceError: If the SDK reports an error.
        """
        if self._is_closed:
            return
        self._is_closed = True
        try:
            self._check(self._dhd.setForce([0.0, 0.0, 0.0], self._id))
            self._check(self._dhd.stop(self._id))  # the brakes keep the handle from falling
        finally:
            self._dhd.close(self._id)

    def _with_watchdog(self) -> ForceCapabilities:
        """Let the device end a force that is not renewed, if its controller can."""
        expert = self._dhd.expert
        is_set = (
            expert.enableExpertMode() == 0
            and expert.setWatchdog(round(WATCHDOG_MS * TICKS_PER_MS), self._id) == 0
        )
        expert.disableExpertMode()
        return replace(type(self).capabilities, holds_ms=WATCHDOG_MS) if is_set else type(self).capabilities

    def _check(self, code: int) -> None:
        """Accept 0 and the positive codes, which say what the SDK did instead, such as limiting a force."""
        if code < 0:
            raise DeviceError(f"{self._dhd.errorGetLastStr()}")


def _binding() -> Any:
    """Return the binding's module `dhd`.

    Raises:
        MissingExtra: If it is not installed.
        BadInput: If it does not find the SDK.
    """
    try:
        with redirect_stdout(None), redirect_stderr(None):  # it prints that it does not find the SDK
            return import_module("forcedimension_core.dhd")
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] == "forcedimension_core":
            raise MissingExtra("force device forcedimension", "forcedimension") from None
        raise
    except (ImportError, AttributeError, OSError):
        raise BadInput(NO_SDK, "forcedimension") from None


def _ours_mm(device_m: list[float]) -> Vec3:
    towards_m, right_m, up_m = device_m
    return 1e3 * right_m, 1e3 * up_m, 1e3 * towards_m
