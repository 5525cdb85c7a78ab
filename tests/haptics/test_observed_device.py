"""Who listens in on a device hears all it is told, also what it fails at."""

import pytest

from haptigraph.errors import DeviceError
from haptigraph.haptics.observed_device import ObservedDevice
from haptigraph.messages import Capabilities
from haptigraph.stages import Device


class Actuator:
    capabilities = Capabilities(3, None, 5.0)

    def __init__(self):
        self.told, self.closed = [], 0

    def set(self, amplitude, frequency_hz, stamp_ns):
        self.told.append((stamp_ns, amplitude, frequency_hz))
        if amplitude > 0.9:
            raise DeviceError("too strong")

    def close(self):
        self.closed += 1


def test_the_listener_hears_what_the_device_is_told():
    actuator, heard = Actuator(), []
    tapped = ObservedDevice(actuator, lambda *edge: heard.append(edge))
    assert isinstance(tapped, Device)
    assert tapped.capabilities == actuator.capabilities
    tapped.set(0.5, 80.0, 1)
    with pytest.raises(DeviceError):
        tapped.set(1.0, 160.0, 2)
    tapped.set(0.0, 0.0, 3)
    tapped.close()
    assert heard == actuator.told == [(1, 0.5, 80.0), (2, 1.0, 160.0), (3, 0.0, 0.0)]
    assert actuator.closed == 1
