"""A simulated CRTK arm in a process of its own, over Cyclone DDS.

crtk_peer.py NAMESPACE                    stands, takes commands
crtk_peer.py NAMESPACE hand SEED [NAME]   once somebody listens, sends 8 s of motion by hand first, sound or with
                                          the sabotage NAME

Prints "ready", and after the motion "done". Ends when its standard input is closed. Lines on it are commands:
pause, fault, quiet (sends no more poses), shake (by 1 mm), steady (neither), or "at X Y Z": somebody moves its
tip there [mm].
"""

import heapq
import sys
import threading
import time
from itertools import count

import arm_motion
import numpy as np
from crtk_messages import START_NS, sabotaged, sound
from crtk_recording import message_of

from haptigraph.ros2.geometry_types import Pose, Quaternion
from haptigraph.ros2.motion_types import OperatingState, PoseStamped, StringStamped
from haptigraph.ros2.node import Node
from haptigraph.ros2.types import Header, Point, Time

TYPES = {
    "measured_cp": PoseStamped,
    "setpoint_cp": PoseStamped,
    "operating_state": OperatingState,
}
BASE = "PSM1_base"
PERIOD_S = 0.01
STEADY_M = 5e-6
ANSWERS = {"enable": "ENABLED", "disable": "DISABLED", "pause": "PAUSED", "resume": "ENABLED"}


class Arm:
    """Follows servo_cp while it is enabled; measured poses leave it after 20 +- 5 ms."""

    def __init__(self, root):
        self.node, self.root, self.rng = Node(), root, np.random.default_rng(5)
        self.out = {}
        self.state, self.is_quiet, self.noise_m = "DISABLED", False, STEADY_M
        tip_m, rotation = arm_motion.forward(np.array([0.1, -0.05, 0.0, 0.005]))
        self.setpoint = (*tip_m.tolist(), *arm_motion.quaternion(rotation).tolist())
        self.due, self.numbers, self.last_s = [], count(), 0.0
        self.node.subscribe(f"{root}/servo_cp", PoseStamped, self.take_pose, print)
        self.node.subscribe(f"{root}/state_command", StringStamped, self.take_command, print)
        for name, message_type in TYPES.items():
            self.publisher(name, message_type)

    def publisher(self, name, message_type, sender=1):
        key = name, sender
        if key not in self.out:
            self.out[key] = self.node.publisher(f"{self.root}/{name}", message_type)
        return self.out[key]

    def take_pose(self, message):
        if self.state == "ENABLED":
            at, turn = message.pose.position, message.pose.orientation
            self.setpoint = (at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w)

    def take_command(self, message):
        self.state = ANSWERS.get(message.string, self.state)
        self.send_state()

    def send_state(self):
        stamp = Time.from_ns(time.time_ns())
        self.publisher("operating_state", OperatingState).send(
            OperatingState(Header(stamp, BASE), self.state, True, False)
        )

    def send(self, name, numbers, stamp_ns):
        pose = Pose(Point(*numbers[:3]), Quaternion(*numbers[3:]))
        self.publisher(name, PoseStamped).send(PoseStamped(Header(Time.from_ns(stamp_ns), BASE), pose))

    def step(self, number):
        """Measure, and send what is due."""
        now_s, stamp_ns = time.monotonic(), time.time_ns()
        if not self.is_quiet:
            noise = self.rng.normal(0, self.noise_m, 3).tolist()
            measured = tuple(a + b for a, b in zip(self.setpoint[:3], noise, strict=True)) + self.setpoint[3:]
            self.last_s = max(self.last_s, now_s + max(self.rng.normal(0.020, 0.005), 0.0))
            heapq.heappush(self.due, (self.last_s, next(self.numbers), measured, stamp_ns))
        while self.due and self.due[0][0] <= now_s:
            _, _, measured, measured_ns = heapq.heappop(self.due)
            self.send("measured_cp", measured, measured_ns)
        self.send("setpoint_cp", self.setpoint, stamp_ns)
        if number % 10 == 0:
            self.send_state()


def play(arm, messages):
    """Send recorded messages when they arrived, now."""
    for one in messages:
        arm.publisher(one.topic, type(message_of(one)), one.sender)
    while not arm.publisher("measured_cp", PoseStamped).has_subscribers:
        time.sleep(0.02)
    time.sleep(0.2)
    start_s, shift_ns = time.monotonic(), time.time_ns() - START_NS
    for one in messages:
        time.sleep(max(start_s + (one.arrival_ns - START_NS) / 1e9 - time.monotonic(), 0))
        message = message_of(one)
        if one.stamp_ns:
            message.header.stamp = Time.from_ns(one.stamp_ns + shift_ns)
        arm.publisher(one.topic, type(message), one.sender).send(message)
    poses = [one for one in messages if one.topic == "measured_cp"]
    arm.setpoint = tuple(map(float, poses[-1].numbers))


def obey(arm):
    for line in sys.stdin:
        command = line.strip()
        arm.is_quiet = {"quiet": True, "steady": False}.get(command, arm.is_quiet)
        arm.noise_m = {"shake": 1e-3, "steady": STEADY_M}.get(command, arm.noise_m)
        if command.startswith("at "):
            arm.setpoint = (*(float(one) / 1e3 for one in command.split()[1:]), *arm.setpoint[3:])
        arm.state = {"pause": "PAUSED", "fault": "FAULT"}.get(command, arm.state)
        arm.send_state()
    arm.is_over = True


def main():
    root, *mode = sys.argv[1:]
    arm = Arm(root)
    arm.is_over = False
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    threading.Thread(target=obey, args=(arm,), daemon=True).start()
    if mode:
        _, seed, *name = mode
        play(arm, sabotaged(name[0], int(seed)) if name else sound(int(seed)))
        sys.stdout.write("done\n")
        sys.stdout.flush()
    number, next_s = 0, time.monotonic()
    while not arm.is_over:
        arm.step(number)
        number, next_s = number + 1, next_s + PERIOD_S
        time.sleep(max(next_s - time.monotonic(), 0))


if __name__ == "__main__":
    main()
