"""A device that neither accepts nor confirms silence once it has vibrated."""

from haptigraph.errors import DeviceError
from haptigraph.messages import Capabilities

PATH = "stuck_device:StuckDevice"
NOT_SILENT = "haptigraph: stuck does not confirm silence; it may still vibrate: switch it off"


class StuckDevice:
    capabilities = Capabilities(100, None, 0.0)

    def __init__(self, argument):
        pass

    def set(self, amplitude, frequency_hz, stamp_ns):
        if stamp_ns:
            raise DeviceError("hung")

    def close(self):
        raise DeviceError("hung")
