"""The connection to a force device is lost while it pushes: seen from the device's end of the network."""

import threading
import time

import pytest
from inverse_service import Service, serving
from ros_network import until

from haptigraph.haptics.force.fixture import Fixture
from haptigraph.haptics.force.messages import ForceInput
from haptigraph.run_force import open_force

WALL = Fixture("plane", (0.0, 5.0, 0.0), (0.0, 1.0, 0.0), stiffness_n_per_mm=0.2, limit_n=2.0)
PUSHES_N = 0.2


class Pushed:
    """A force device that is given a wall 30 times a second, 5 mm beyond which the hand is."""

    def __init__(self, name):
        self.process, self.ends = open_force(name, 150.0), threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        while not self.ends.wait(1 / 30):
            self.process.send(ForceInput((WALL,), (0.0, 0.0, 0.0), time.monotonic_ns(), 1.0))

    def close(self):
        self.ends.set()
        self.thread.join()
        self.process.close()


def newton(forces):
    return max(map(abs, forces[-1])) if forces else 0.0


@pytest.mark.parametrize("how", ["closed", "silent"])
def test_a_websocket_that_is_lost_is_opened_again_and_the_first_force_is_zero(how):
    service = Service()
    service.buttons["a"] = True
    with serving(service):
        pushed = Pushed(f"inverse3:{service.address}")
        until(lambda: newton([force for _, force in service.forces]) > PUSHES_N, "it does not push")
        if how == "silent":
            service.is_silent = True
        else:
            service.drop()
        problems = []
        until(lambda: problems.extend(pushed.process.take_problems()) or problems, "nothing is said")
        lost = len(service.forces)
        service.is_silent = False
        until(
            lambda: (0.0, 0.0, 0.0) in [force for _, force in service.forces[lost - 5 :]], "it is not let go"
        )
        until(lambda: newton([force for _, force in service.forces]) > PUSHES_N, "it does not push again")
        pushed.close()
        assert service.forces[-1][1] == (0.0, 0.0, 0.0) and pushed.process.has_let_go


def test_an_arm_that_falls_silent_is_let_go(ros_network):
    pytest.importorskip("cyclonedds")
    from crtk_arm import Arm

    arm = Arm()
    arm.is_present = True
    pushed = Pushed("crtk:MTML")
    until(lambda: newton(arm.forces) > PUSHES_N, "it does not push")
    arm.is_silent = True
    until(lambda: newton(arm.forces) == 0.0, "it pushes on")
    arm.is_silent = False
    until(lambda: newton(arm.forces) > PUSHES_N, "it does not push again")
    pushed.close()
    until(lambda: newton(arm.forces) == 0.0, "it pushes on after the end")
    arm.close()
