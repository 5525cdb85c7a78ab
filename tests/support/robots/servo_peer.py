"""A simulated arm behind MoveIt Servo in a process of its own, over Cyclone DDS: servo_peer.py NODE.

Prints "ready", and a line for each service that is called. Ends when its standard input is closed. Lines on it
are commands: pause (no more status), quiet (no more tf), refuse (what services ask), or a number: the code of the
status from now on. With `plain` after NODE, its services are Fast DDS's: without a header before the messages.
"""

import sys
import threading
import time
from dataclasses import astuple

from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from haptigraph.robot.ros.servo import PAUSE, SWITCH
from haptigraph.ros2.geometry_types import Quaternion, TFMessage, Transform, TransformStamped, Vector3
from haptigraph.ros2.motion_types import PoseStamped, ServoStatus
from haptigraph.ros2.node import Node
from haptigraph.ros2.qos import SERVICE
from haptigraph.ros2.services import _with_header
from haptigraph.ros2.types import Header, Time

PERIOD_S = 0.01
FLANGE_M = 0.05  # from the moving link to the tool, along x


class Arm:
    """Goes where it is commanded, at once."""

    def __init__(self, node_name):
        self.node, self.code = Node(), 0
        self.at_m, self.turn = (0.12, -0.03, 0.10), (0.0, 0.0, 0.0, 1.0)
        self.is_paused = self.is_quiet = self.is_over = self.refuses = False
        self.tf = self.node.publisher("/tf", TFMessage)
        self.static = self.node.publisher("/tf_static", TFMessage)
        self.status = self.node.publisher(f"{node_name}/status", ServoStatus)
        self.node.subscribe(f"{node_name}/pose_target_cmds", PoseStamped, self.take, print)
        self.static.send(TFMessage([moved("link6", "tool0", (FLANGE_M, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))]))

    def serve(self, node_name, has_header):
        """Offer Servo's services."""
        participant, services = self.node.participant, []
        for name, kinds in (("switch_command_type", SWITCH), ("pause_servo", PAUSE)):
            request, reply = (_with_header(kind) if has_header else kind for kind in kinds)
            asked = Topic(participant, f"rq{node_name}/{name}Request", request)
            answers = Topic(participant, f"rr{node_name}/{name}Reply", reply)
            reader = DataReader(participant, asked, qos=SERVICE.qos)
            services.append((name, reader, DataWriter(participant, answers, qos=SERVICE.qos), reply))
        self.services = services

    def answer(self):
        for name, reader, writer, reply in self.services:
            for asked in reader.take():
                if isinstance(asked, InvalidSample):  # its client has left
                    continue
                *header, value = astuple(asked)
                sys.stdout.write(f"{name} {value}\n")
                sys.stdout.flush()
                if name == "pause_servo" and not self.refuses:
                    self.is_paused = value
                message = [""] if name == "pause_servo" else []
                writer.write(reply(*header, not self.refuses, *message))

    def take(self, message):
        if not self.is_paused:
            at, turn = message.pose.position, message.pose.orientation
            self.at_m, self.turn = (at.x - FLANGE_M, at.y, at.z), (turn.x, turn.y, turn.z, turn.w)

    def step(self):
        self.answer()
        if not self.is_quiet:
            self.tf.send(TFMessage([moved("base_link", "link6", self.at_m, self.turn)]))
        if not self.is_paused:
            self.status.send(ServoStatus(self.code, ""))

    def obey(self):
        for line in sys.stdin:
            command = line.strip()
            self.is_paused |= command == "pause"
            self.is_quiet |= command == "quiet"
            self.refuses |= command == "refuse"
            if command.lstrip("-").isdigit():
                self.code = int(command)
        self.is_over = True


def moved(parent, child, at_m, turn):
    header = Header(Time.from_ns(time.time_ns()), parent)
    return TransformStamped(header, child, Transform(Vector3(*at_m), Quaternion(*turn)))


def main():
    arm = Arm(sys.argv[1])
    arm.serve(sys.argv[1], has_header="plain" not in sys.argv)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    threading.Thread(target=arm.obey, daemon=True).start()
    while not arm.is_over:
        arm.step()
        time.sleep(PERIOD_S)


if __name__ == "__main__":
    main()
