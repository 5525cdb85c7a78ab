"""The observer of a device is notified of every command, including those that fail."""

import pytest

from haptigraph.errors import DeviceError
from haptigraph.haptics.observed_device import ObservedDevice
from haptigraph.messages import Capabilities
from haptigraph.stages import Device


class Actuator:
    capabilities = Capabilities(3, None, 5.0)

    def __init__(self):
        self.log, self.closed = [], 0

    def set(self, amplitude, frequency_hz, stamp_ns):
        self.log.append((stamp_ns, amplitude, frequency_hz))
        if amplitude > 0.9:
            raise DeviceError("too strong")

    def close(self):
        self.closed += 1


def test_the_listener_is_notified_of_every_command():
    actuator, observed = Actuator(), []
    device = ObservedDevice(actuator, lambda *edge: observed.append(edge))
    assert isinstance(device, Device)
    assert device.capabilities == actuator.capabilities
    device.set(0.5, 80.0, 1)
    with pytest.raises(DeviceError):
        device.set(1.0, 160.0, 2)
    device.set(0.0, 0.0, 3)
    device.close()
    assert observed == actuator.log == [(1, 0.5, 80.0), (2, 1.0, 160.0), (3, 0.0, 0.0)]
    assert actuator.closed == 1
