"""A CRTK arm as a real ROS 2 node (rclpy), run in an environment with ROS's wheels and generated messages.

ros_arm.py NAMESPACE ARM_FILE SEED PLACE, where ARM_FILE is haptigraph/sim/robot/arm.py, which needs NumPy alone,
and PLACE a JSON object with rcm_mm and eye_mm. Lines on standard input are commands, each answered by one line:

hand      its user moves it by hand in every direction from now on
place     its user puts it in front of the trocar, 10 mm outside
pause, fault, reset              the operating state from now on; reset: DISABLED
quiet, freeze, lost, sound       no more poses; stamps that stay; nothing in and out; as before
report    what was commanded and what the true arm did since the last report, as JSON
"""

import importlib.util
import json
import math
import os
import sys
import threading
import time
from contextlib import suppress

import numpy as np
import rclpy
from crtk_msgs.msg import OperatingState, StringStamped
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState

BASE = "arm_base"
PERIOD_S = 0.005
START_MM = 10.0
MOVING_MM = 1e-6
ANSWERS = {
    ("DISABLED", "enable"): "ENABLED",
    ("ENABLED", "disable"): "DISABLED",
    ("PAUSED", "disable"): "DISABLED",
    ("FAULT", "disable"): "DISABLED",
    ("ENABLED", "pause"): "PAUSED",
    ("PAUSED", "resume"): "ENABLED",
}


def module_of(path):
    spec = importlib.util.spec_from_file_location("arm", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["arm"] = module
    spec.loader.exec_module(module)
    return module


def quaternion_of(rotation):
    """x, y, z, w, from the eigenvector of Bar-Itzhack's matrix."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    matrix = [
        [xx - yy - zz, yx + xy, zx + xz, zy - yz],
        [yx + xy, yy - xx - zz, zy + yz, xz - zx],
        [zx + xz, zy + yz, zz - xx - yy, yx - xy],
        [zy - yz, xz - zx, yx - xy, xx + yy + zz],
    ]
    return np.linalg.eigh(np.array(matrix) / 3)[1][:, -1]


def rotation_of(x, y, z, w):
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def frame_along(z_axis):
    """A right-handed frame whose z axis is given."""
    x_axis = np.cross((0.0, 1.0, 0.0), z_axis)
    x_axis /= np.linalg.norm(x_axis)
    return np.column_stack([x_axis, np.cross(z_axis, x_axis), z_axis])


class RosArm:
    def __init__(self, namespace, arms, seed, place):
        self.node = rclpy.create_node("arm")
        self.rcm_mm, eye_mm = np.array(place["rcm_mm"]), np.array(place["eye_mm"])
        inwards = (eye_mm - self.rcm_mm) / np.linalg.norm(eye_mm - self.rcm_mm)
        self.mount = frame_along(inwards)
        self.home_mm = self.rcm_mm - START_MM * inwards
        self.arm = arms.Arm(self.home_mm, self.mount, seed, start_ns=time.monotonic_ns())
        self.state, self.is_homed, self.fault, self.hand_ns = "DISABLED", False, "", None
        self.before, self.frozen_stamp = None, None
        self.lock = threading.RLock()
        self.clear()
        publisher = self.node.create_publisher
        self.out = {
            name: publisher(kind, f"{namespace}/{name}", 10)
            for name, kind in (
                ("measured_cp", PoseStamped),
                ("measured_cv", TwistStamped),
                ("measured_js", JointState),
                ("setpoint_cp", PoseStamped),
                ("operating_state", OperatingState),
            )
        }
        self.node.create_subscription(PoseStamped, f"{namespace}/servo_cp", self.take_pose, 10)
        self.node.create_subscription(StringStamped, f"{namespace}/state_command", self.take_command, 10)
        self.node.create_timer(PERIOD_S, self.step)
        self.node.create_timer(0.05, self.send_state)

    def clear(self):
        self.commands, self.last_motion_ns, self.command_mm = 0, 0, None
        self.commanded_rcm_mm, self.true_rcm_mm, self.depths_mm, self.moving = [], [], [], False

    def stamped(self, message, monotonic_ns):
        utc_ns = monotonic_ns + time.time_ns() - time.monotonic_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(utc_ns, 10**9)
        message.header.frame_id = BASE
        return message

    def pose_message(self, position_mm, rotation, monotonic_ns):
        message = self.stamped(PoseStamped(), monotonic_ns)
        at, turn = message.pose.position, message.pose.orientation
        at.x, at.y, at.z = (np.asarray(position_mm) / 1e3).tolist()
        turn.x, turn.y, turn.z, turn.w = quaternion_of(rotation).tolist()
        return message

    def miss_mm(self, tip_mm, axis):
        return float(np.linalg.norm(np.cross(tip_mm - self.rcm_mm, axis)))

    def take_pose(self, message):
        with self.lock:
            if self.state != "ENABLED" or not self.is_homed or self.fault == "lost":
                return
            at, turn = message.pose.position, message.pose.orientation
            tip_mm, rotation = 1e3 * np.array([at.x, at.y, at.z]), rotation_of(turn.x, turn.y, turn.z, turn.w)
            now_ns = time.monotonic_ns()
            if self.command_mm is None or np.abs(tip_mm - self.command_mm).max() > MOVING_MM:
                self.last_motion_ns = now_ns
            self.command_mm = tip_mm
            self.commands += 1
            self.commanded_rcm_mm.append(self.miss_mm(tip_mm, rotation[:, 2]))
            self.arm.command(now_ns, tip_mm, rotation)
            self.out["setpoint_cp"].publish(self.pose_message(tip_mm, rotation, now_ns))

    def take_command(self, message):
        with self.lock:
            if self.fault == "lost":
                return
            self.is_homed |= message.string == "home" and self.state == "ENABLED"
            self.set_state(ANSWERS.get((self.state, message.string), self.state))

    def set_state(self, state):
        self.state = state
        if state != "ENABLED":
            self.arm.hold(time.monotonic_ns())
        self.send_state()

    def send_state(self):
        if self.fault != "lost":
            message = self.stamped(OperatingState(), time.monotonic_ns())
            message.state, message.is_homed = self.state, self.is_homed
            self.out["operating_state"].publish(message)

    def step(self):
        with self.lock:
            now_ns = time.monotonic_ns()
            if self.hand_ns is not None:
                self.move_by_hand(now_ns, (now_ns - self.hand_ns) / 1e9)
            self.arm.advance(now_ns)
            true = self.arm.pose
            if self.commands:
                self.true_rcm_mm.append(self.miss_mm(true.position_mm, true.rotation[:, 2]))
                self.depths_mm.append(float((true.position_mm - self.rcm_mm) @ true.rotation[:, 2]))
            while self.arm.arrived:
                _, measured = self.arm.arrived.popleft()
                if self.fault not in ("quiet", "lost"):
                    self.send(measured)

    def send(self, measured):
        if self.fault == "freeze":
            self.frozen_stamp = self.frozen_stamp or measured.stamp_ns
        stamp_ns = self.frozen_stamp if self.fault == "freeze" else measured.stamp_ns
        self.out["measured_cp"].publish(self.pose_message(measured.position_mm, measured.rotation, stamp_ns))
        joints = self.stamped(JointState(), stamp_ns)
        joints.name = ["x", "y", "z", "tilt_x", "tilt_y", "roll"]
        values = self.arm.joints * np.array([1e-3] * 3 + [math.pi / 180] * 3)
        joints.position = values.tolist()
        self.out["measured_js"].publish(joints)
        if self.before is not None and measured.stamp_ns > self.before.stamp_ns:
            self.send_twist(measured, (measured.stamp_ns - self.before.stamp_ns) / 1e9, stamp_ns)
        self.before = measured

    def send_twist(self, measured, elapsed_s, stamp_ns):
        message = self.stamped(TwistStamped(), stamp_ns)
        velocity = (measured.position_mm - self.before.position_mm) / 1e3 / elapsed_s
        turned = (measured.rotation @ self.before.rotation.T - np.eye(3)) / elapsed_s
        linear, angular = message.twist.linear, message.twist.angular
        linear.x, linear.y, linear.z = velocity.tolist()
        angular.x, angular.y, angular.z = float(turned[2, 1]), float(turned[0, 2]), float(turned[1, 0])
        self.out["measured_cv"].publish(message)

    def move_by_hand(self, now_ns, time_s):
        """About the trocar: tilts, turns, goes in and out."""
        angles = 0.35 * np.sin([1.1 * time_s, 1.7 * time_s, 0.9 * time_s])
        rotation = self.mount
        for axis, angle in enumerate(angles):
            i, j = (axis + 1) % 3, (axis + 2) % 3
            turn = np.eye(3)
            turn[i, i] = turn[j, j] = math.cos(angle)
            turn[j, i], turn[i, j] = math.sin(angle), -math.sin(angle)
            rotation = rotation @ turn
        depth_mm = -10.0 - 15.0 * math.sin(1.3 * time_s)
        self.arm.command(now_ns, self.rcm_mm + depth_mm * rotation[:, 2], rotation)

    def obey(self, command):
        with self.lock:
            if command == "hand":
                self.hand_ns = time.monotonic_ns()
            elif command == "place":
                self.hand_ns = None
                self.arm.command(time.monotonic_ns(), self.home_mm, self.mount)
            elif command in ("pause", "fault", "reset"):
                self.set_state({"pause": "PAUSED", "fault": "FAULT", "reset": "DISABLED"}[command])
            elif command in ("quiet", "freeze", "lost", "sound"):
                self.fault, self.frozen_stamp = ("" if command == "sound" else command), None
            answer = {"at_ns": time.monotonic_ns()}
            if command == "report":
                true_mm, depths_mm = np.array(self.true_rcm_mm or [0.0]), np.array(self.depths_mm or [0.0])
                inserted_mm = true_mm[depths_mm >= 0.0]
                answer |= {
                    "commands": self.commands,
                    "last_motion_ns": self.last_motion_ns,
                    "commanded_rcm_mm": max(self.commanded_rcm_mm, default=0.0),
                    "inserted_p95_mm": float(np.percentile(inserted_mm, 95)) if len(inserted_mm) else 0.0,
                    "inserted_mm": float(inserted_mm.max(initial=0.0)),
                    "approaching_mm": float(true_mm[depths_mm < 0.0].max(initial=0.0)),
                    "depth_mm": float(depths_mm.max()),
                }
                self.clear()
            return answer


def main():
    with suppress(OSError):  # it stands for a machine of its own
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(20))
    namespace, arm_file, seed, place = sys.argv[1:]
    rclpy.init()
    arm = RosArm(namespace, module_of(arm_file), int(seed), json.loads(place))
    executor = SingleThreadedExecutor()
    executor.add_node(arm.node)
    threading.Thread(target=executor.spin, daemon=True).start()
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    for line in sys.stdin:
        sys.stdout.write(json.dumps(arm.obey(line.strip())) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
