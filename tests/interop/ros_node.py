"""A real ROS 2 node (rclpy), run in an environment with ROS's wheels; prints its results as JSON.

ros_node.py camera FOLDER N    sends N images, waits for the needle tip of each, counts every topic
ros_node.py stick N            sends N Joy messages, and measures the motion of the needle
ros_node.py raw W H N          sends N raw images of W x H px, 30 a second
ros_node.py echo               returns JoyFeedback messages, until one has intensity 2
"""

import json
import os
import sys
import time
from array import array
from collections import Counter, defaultdict
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage, Image, JointState, Joy, JoyFeedback

TOPICS = {
    "/haptigraph/state": DiagnosticArray,
    "/haptigraph/graph": DiagnosticArray,
    "/haptigraph/needle_tip": PointStamped,
    "/haptigraph/needle": PoseWithCovarianceStamped,
    "/haptigraph/theta": JointState,
    "/haptigraph/touch": JointState,
    "/joy/set_feedback": JoyFeedback,
    "/diagnostics": DiagnosticArray,
}
TIMEOUT_S = 60.0


class Received:
    """Messages of every topic."""

    def __init__(self, node):
        self.node, self.counts, self.last, self.stamps = node, Counter(), {}, defaultdict(set)
        for topic, kind in TOPICS.items():
            node.create_subscription(kind, topic, lambda message, topic=topic: self.take(topic, message), 10)

    def take(self, topic, message):
        self.counts[topic] += 1
        self.last[topic] = message
        if hasattr(message, "header"):
            self.stamps[topic].add(ns_of(message.header.stamp))

    def until(self, holds, timeout_s=TIMEOUT_S):
        end_s = time.monotonic() + timeout_s
        while not holds() and time.monotonic() < end_s:
            rclpy.spin_once(self.node, timeout_sec=0.02)
        return holds()


def ns_of(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


def camera(node, folder, count):
    received = Received(node)
    publisher = node.create_publisher(CompressedImage, "/camera/image/compressed", qos_profile_sensor_data)
    images = [path.read_bytes() for path in sorted(Path(folder).glob("*.jpg"))]
    assert received.until(
        lambda: publisher.get_subscription_count() and node.count_publishers("/haptigraph/needle_tip")
    )
    end_s = time.monotonic() + TIMEOUT_S
    while (
        "/haptigraph/needle_tip" not in received.last and time.monotonic() < end_s
    ):  # until discovery is complete
        show(node, publisher, images[0])
        received.until(lambda: "/haptigraph/needle_tip" in received.last, 0.2)
    received.until(lambda: False, 0.5)
    received.counts.clear()
    round_trips_ms, sent = [], []
    for number in range(count):
        sent.append(show(node, publisher, images[number % len(images)]))
        if received.until(lambda: sent[-1] in received.stamps["/haptigraph/needle_tip"], 2.0):
            round_trips_ms.append((node.get_clock().now().nanoseconds - sent[-1]) / 1e6)
    received.until(lambda: sent[-1] in received.stamps["/haptigraph/needle"], 2.0)
    graph = (
        received.last["/haptigraph/graph"].status[0].message
    )  # before the run reports that images are missing
    received.until(lambda: received.counts["/diagnostics"] and received.counts["/haptigraph/touch"], 5.0)
    received.until(lambda: False, 0.5)
    tip, pose = received.last["/haptigraph/needle_tip"], received.last["/haptigraph/needle"].pose
    orientation = pose.pose.orientation
    return {
        "round_trips_ms": round_trips_ms,
        "counts": received.counts,
        "paired": {topic: len(stamps.intersection(sent)) for topic, stamps in received.stamps.items()},
        "quaternion": [orientation.x, orientation.y, orientation.z, orientation.w],
        "covariance": pose.covariance.tolist(),
        "state": received.last["/haptigraph/state"].status[0].message,
        "theta": [
            list(received.last["/haptigraph/theta"].name),
            len(received.last["/haptigraph/theta"].position),
        ],
        "touch": [
            list(received.last["/haptigraph/touch"].name),
            len(received.last["/haptigraph/touch"].effort),
        ],
        "frame_id": tip.header.frame_id,
        "tip_m": [tip.point.x, tip.point.y, tip.point.z],
        "graph": graph,
        "level": received.last["/diagnostics"].status[0].level[0],
        "types": {name: kinds for name, kinds in node.get_topic_names_and_types() if name in TOPICS},
    }


def show(node, publisher, data):
    now = node.get_clock().now()
    message = CompressedImage(format="jpeg", data=data)
    message.header.stamp, message.header.frame_id = now.to_msg(), "camera"
    publisher.publish(message)
    return now.nanoseconds


def stick(node, count):
    received = Received(node)
    publisher = node.create_publisher(Joy, "/joy", 10)
    assert received.until(
        lambda: publisher.get_subscription_count() >= 2 and "/haptigraph/needle_tip" in received.last
    )
    received.until(lambda: False, 0.5)
    before = received.last["/haptigraph/needle_tip"].point
    for number in range(count):
        message = Joy(axes=[0.0, 1.0, 0.5], buttons=[0, 0, 0, 0, 0, 1])
        message.header.stamp.sec = number
        publisher.publish(message)
        rclpy.spin_once(node, timeout_sec=0.005)
    received.until(lambda: False, 1.0)
    after = received.last["/haptigraph/needle_tip"].point
    return {"moved_mm": 1e3 * ((after.x - before.x) ** 2 + (after.y - before.y) ** 2) ** 0.5}


def raw(node, width, height, count):
    publisher = node.create_publisher(
        Image, "/camera/image_raw", 10
    )  # reliable, as cameras' drivers are by default
    end_s = time.monotonic() + TIMEOUT_S
    while not publisher.get_subscription_count() and time.monotonic() < end_s:
        rclpy.spin_once(node, timeout_sec=0.1)
    message = Image(height=height, width=width, encoding="bgr8", step=3 * width)
    message.data = array("B", os.urandom(3 * width * height))
    begin_s = time.monotonic() + 2.0  # the subscriber adapts to the publisher
    for number in range(count):
        time.sleep(max(begin_s + number / 30 - time.monotonic(), 0))
        message.header.stamp = node.get_clock().now().to_msg()
        publisher.publish(message)
    time.sleep(2.0)
    return {"sent": count}


def echo(node):
    publisher, received = node.create_publisher(JoyFeedback, "/back", 10), Counter()

    def back(message):
        received["messages"] += message.intensity >= 0
        received["end"] += message.intensity == 2.0
        publisher.publish(message)

    node.create_subscription(JoyFeedback, "/forth", back, 10)
    end_s = time.monotonic() + TIMEOUT_S
    while not received["end"] and time.monotonic() < end_s:
        rclpy.spin_once(node, timeout_sec=0.1)
    return {"received": received["messages"] - received["end"]}


def main():
    role, *arguments = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node("haptigraph_interop")
    if role == "camera":
        result = camera(node, arguments[0], int(arguments[1]))
    else:
        result = {"stick": stick, "echo": echo, "raw": raw}[role](node, *map(int, arguments))
    sys.stdout.write(json.dumps(result) + "\n")
    sys.stdout.flush()
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
