"""For every kind of leader something that moves it as a hand would, without hardware; time is a VirtualClock's."""

import os
import pty
import select
import sys

from ros_network import Peer, until

from haptigraph.clock import VirtualClock
from haptigraph.teleop.leaders.opening import open_leader


class Rig:
    """A leader and its hand: `hold` presses the dead-man, `deflect` moves the hand for 50 ms."""

    uri = ""

    def __init__(self):
        self.clock = VirtualClock(1_000_000_000)
        self.prepare()
        self.leader = open_leader(self.uri, self.clock)

    def prepare(self):
        pass

    def wait(self, ms=50):
        self.clock.wait_until(self.clock.now_ns() + round(ms * 1e6))

    def close(self):
        self.leader.close()


class GamepadRig(Rig):
    uri = "gamepad:0"

    def prepare(self):
        from virtual_pad import VirtualPad

        self.pad = VirtualPad()

    def hold(self, is_held):
        self.pad.press(10, is_held)

    def deflect(self):
        self.leader.take()
        for axis in (0, 1, 3):
            self.pad.tilt(axis, 1.0)
        self.wait()

    def lose(self):
        self.pad.detach()

    def restore(self):
        """A pad that is plugged in while somebody holds its button."""
        self.prepare()
        self.hold(True)

    def close(self):
        super().close()
        self.pad.detach()


class KeysRig(Rig):
    uri = "keys"

    def prepare(self):
        self.hand, self.terminal = pty.openpty()
        self._stdin, sys.stdin = sys.stdin, os.fdopen(os.dup(self.terminal), "rb", buffering=0)

    def hold(self, is_held):
        self.is_held = is_held

    def deflect(self):
        os.write(self.hand, b"s" if self.is_held else b"x")
        until(self._is_readable, "no key")
        self.leader.take()
        self.wait()

    def _is_readable(self):
        return select.select([self.terminal], [], [], 0)[0]

    def lose(self):
        os.close(self.hand)
        self.hand = None

    restore = None
    """A closed terminal does not come back."""

    def close(self):
        super().close()
        stream, sys.stdin = sys.stdin, self._stdin
        stream.close()
        os.close(self.terminal)
        if self.hand is not None:
            os.close(self.hand)


class NetworkRig(Rig):
    """A leader behind a network; messages arrive in another thread."""

    received = 0

    def prepare(self):
        self.peer = Peer()

    def send(self, publisher, message):
        """Publish a message, and wait until the leader has processed it."""
        before = self.received
        publisher.send(message)
        until(lambda: self.received > before, "the message did not arrive")

    def count(self, watched):
        """Count the messages that a leader accepts."""
        heard = watched.heard

        def counted():
            heard()
            self.received += 1

        watched.heard = counted

    def lose(self):
        self.wait(5000)

    def close(self):
        super().close()
        self.peer.node.close()


class JoyRig(NetworkRig):
    uri = "joy:contract/joy"

    def __init__(self):
        super().__init__()
        from haptigraph.ros2.types import Joy

        self.count(self.leader._silence)
        self.publisher = self.peer.publisher("/contract/joy", Joy)
        self.is_held = False

    def hold(self, is_held):
        self.is_held = is_held
        self.send_joy([0.0] * 5)

    def deflect(self):
        self.send_joy([0.0] * 5)
        self.leader.take()
        self.wait()
        self.send_joy([-1.0, -1.0, 0.0, 0.0, -1.0])

    def send_joy(self, axes):
        from haptigraph.ros2.types import Header, Joy

        self.send(self.publisher, Joy(Header(), axes, [0] * 5 + [int(self.is_held)]))

    def restore(self):
        self.deflect()


class CrtkRig(NetworkRig):
    uri = "crtk:contract/MTML"

    def __init__(self):
        super().__init__()
        from haptigraph.ros2.motion_types import PoseStamped
        from haptigraph.ros2.types import Joy

        self.at_m = 0.0
        self.count(self.leader._silence)
        self.pose = self.peer.publisher("/contract/MTML/measured_cp", PoseStamped)
        self.operator = self.peer.publisher("/console/operator_present", Joy)
        self.pedal = self.peer.publisher("/footpedals/clutch", Joy)

    def hold(self, is_held):
        from haptigraph.ros2.types import Header, Joy

        self.operator.send(Joy(Header(), [], [int(is_held)]))
        until(lambda: self.leader._steering._is_present is is_held, "the dead-man did not arrive")
        self.send_pose()

    def deflect(self):
        self.send_pose()
        self.leader.take()
        self.wait()
        self.at_m += 0.002
        self.send_pose()

    def send_pose(self):
        from haptigraph.ros2.geometry_types import Pose, Quaternion
        from haptigraph.ros2.motion_types import PoseStamped
        from haptigraph.ros2.types import Header, Point

        at = Point(self.at_m, -self.at_m, self.at_m)
        self.send(self.pose, PoseStamped(Header(), Pose(at, Quaternion())))

    def restore(self):
        self.deflect()


RIGS = {"crtk": CrtkRig, "gamepad": GamepadRig, "joy": JoyRig, "keys": KeysRig}
