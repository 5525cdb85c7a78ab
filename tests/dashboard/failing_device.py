"""`haptigraph` with a device `failing`, which is unplugged after SIGUSR1 and responds again after SIGUSR2."""

import signal
import threading

from haptigraph import run_device
from haptigraph.cli import main
from haptigraph.errors import DeviceError
from haptigraph.messages import Capabilities

unplugged = threading.Event()


class FailingDevice:
    capabilities = Capabilities(100, None, 0.0, holds_ms=100.0)

    def __init__(self, argument: str) -> None:
        signal.signal(signal.SIGUSR1, lambda *_: unplugged.set())
        signal.signal(signal.SIGUSR2, lambda *_: unplugged.clear())

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        if unplugged.is_set():
            raise DeviceError("unplugged")

    def close(self) -> None:
        pass


if __name__ == "__main__":
    run_device.DEVICES["failing"] = "failing_device:FailingDevice"
    main()
