"""Force devices that fail, for the process that runs them."""

from haptigraph.errors import BadInput, DeviceError
from haptigraph.haptics.force.interface import ForceCapabilities, HandReading

ZERO = (0.0, 0.0, 0.0)


class Steady:
    """A hand that holds the clutch and does not move."""

    capabilities = ForceCapabilities(3.0, 1000.0, 250.0)

    def __init__(self, argument, clock):
        self.clock = clock

    def exchange(self, force_n):
        return HandReading(self.clock.now_ns(), ZERO, ZERO, True)

    def close(self):
        pass


class Absent(Steady):
    def __init__(self, argument, clock):
        raise BadInput("nothing is plugged in", argument)


class Crashing(Steady):
    def __init__(self, argument, clock):
        raise RuntimeError("a mistake")


class Doubtful(Steady):
    def close(self):
        raise DeviceError("no confirmation")


class Breaking(Steady):
    """It fails in its 100th exchange, but lets go."""

    count = 0

    def exchange(self, force_n):
        self.count += 1
        if self.count == 100:
            raise DeviceError("the cable is loose")
        return super().exchange(force_n)
