"""MoveIt Servo's topics as a real ROS 2 node (rclpy), with an arm that goes where it is commanded at once.

ros_servo.py NODE; ends when its standard input is closed.
"""

import sys
import threading

import rclpy
from geometry_msgs.msg import PoseStamped, TransformStamped
from moveit_msgs.msg import ServoStatus
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage


class Servo:
    def __init__(self, name):
        self.node = rclpy.create_node(name)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.static = self.node.create_publisher(TFMessage, "/tf_static", latched)
        self.static.publish(TFMessage(transforms=[self.moved("link6", "tool0", (0.05, 0.0, 0.0))]))
        self.tf = self.node.create_publisher(TFMessage, "/tf", 100)
        self.status = self.node.create_publisher(ServoStatus, f"/{name}/status", 10)
        self.node.create_subscription(PoseStamped, f"/{name}/pose_target_cmds", self.take, 10)
        self.node.create_service(SetBool, f"/{name}/pause_servo", self.pause)
        self.is_paused = True
        self.node.create_timer(0.01, self.step)
        self.at_m = (0.12, -0.03, 0.10)

    def moved(self, parent, child, at_m):
        stamped = TransformStamped(child_frame_id=child)
        stamped.header.frame_id, stamped.header.stamp = parent, self.node.get_clock().now().to_msg()
        to = stamped.transform.translation
        to.x, to.y, to.z = at_m
        return stamped

    def take(self, message):
        at = message.pose.position
        self.at_m = (at.x - 0.05, at.y, at.z)

    def pause(self, request, response):
        self.is_paused, response.success = request.data, True
        return response

    def step(self):
        self.tf.publish(TFMessage(transforms=[self.moved("base_link", "link6", self.at_m)]))
        if not self.is_paused:
            self.status.publish(ServoStatus(code=0, message="No warnings"))


def main():
    rclpy.init()
    servo = Servo(sys.argv[1])
    threading.Thread(target=rclpy.spin, args=(servo.node,), daemon=True).start()
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    sys.stdin.read()


if __name__ == "__main__":
    main()
