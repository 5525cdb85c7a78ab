"""A real ROS 2 node (rclpy), run by the Python of an environment with ROS's wheels. Tells what it met as JSON.

ros_node.py camera FOLDER N    sends N images, waits for the needle's place of each, counts every topic
ros_node.py stick N            sends N Joy messages, and sees the needle move
ros_node.py echo               sends JoyFeedback back as they come, until one says 2
"""

import json
import sys
import time
from collections import Counter
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage, Joy, JoyFeedback
from std_msgs.msg import Float64, String

TOPICS = {
    "/haptigraph/state": String,
    "/haptigraph/graph": String,
    "/haptigraph/needle_tip": PointStamped,
    "/haptigraph/theta": Float64,
    "/haptigraph/touch": JoyFeedback,
    "/joy/set_feedback": JoyFeedback,
    "/diagnostics": DiagnosticArray,
}
PATIENCE_S = 60.0


class Met:
    """What came on every topic."""

    def __init__(self, node):
        self.node, self.counts, self.last = node, Counter(), {}
        for topic, kind in TOPICS.items():
            node.create_subscription(kind, topic, lambda message, topic=topic: self.take(topic, message), 10)

    def take(self, topic, message):
        self.counts[topic] += 1
        self.last[topic] = message

    def until(self, holds, timeout_s=PATIENCE_S):
        end_s = time.monotonic() + timeout_s
        while not holds() and time.monotonic() < end_s:
            rclpy.spin_once(self.node, timeout_sec=0.02)
        return holds()


def tip_stamp(met):
    tip = met.last.get("/haptigraph/needle_tip")
    return None if tip is None else tip.header.stamp.sec * 10**9 + tip.header.stamp.nanosec


def camera(node, folder, count):
    met = Met(node)
    say = node.create_publisher(CompressedImage, "/camera/image/compressed", qos_profile_sensor_data)
    images = [path.read_bytes() for path in sorted(Path(folder).glob("*.jpg"))]
    assert met.until(lambda: say.get_subscription_count() and node.count_publishers("/haptigraph/needle_tip"))
    end_s = time.monotonic() + PATIENCE_S
    while "/haptigraph/needle_tip" not in met.last and time.monotonic() < end_s:  # until all know each other
        show(node, say, images[0])
        met.until(lambda: "/haptigraph/needle_tip" in met.last, 0.2)
    met.until(lambda: False, 0.5)
    met.counts.clear()
    round_trips_ms = []  # an image that comes after it was missed is stamped later: no stamp of a run turns back
    for number in range(count):
        sent_ns = show(node, say, images[number % len(images)])
        if met.until(lambda sent_ns=sent_ns: tip_stamp(met) > sent_ns - 1_000_000, 2.0):
            round_trips_ms.append((node.get_clock().now().nanoseconds - sent_ns) / 1e6)
    graph = met.last["/haptigraph/graph"].data  # before it finds that there are no more images
    met.until(lambda: met.counts["/diagnostics"] and met.counts["/haptigraph/touch"], 5.0)
    met.until(lambda: False, 0.5)
    tip = met.last["/haptigraph/needle_tip"]
    return {
        "round_trips_ms": round_trips_ms,
        "counts": met.counts,
        "frame_id": tip.header.frame_id,
        "tip_m": [tip.point.x, tip.point.y, tip.point.z],
        "graph": graph,
        "level": met.last["/diagnostics"].status[0].level[0],
        "types": {name: kinds for name, kinds in node.get_topic_names_and_types() if name in TOPICS},
    }


def show(node, say, data):
    now = node.get_clock().now()
    message = CompressedImage(format="jpeg", data=data)
    message.header.stamp, message.header.frame_id = now.to_msg(), "camera"
    say.publish(message)
    return now.nanoseconds


def stick(node, count):
    met = Met(node)
    say = node.create_publisher(Joy, "/joy", 10)
    assert met.until(lambda: say.get_subscription_count() >= 2 and "/haptigraph/needle_tip" in met.last)
    met.until(lambda: False, 0.5)
    before = met.last["/haptigraph/needle_tip"].point
    for number in range(count):
        message = Joy(axes=[0.0, 1.0, 0.5], buttons=[0, 0, 0, 0, 0, 1])
        message.header.stamp.sec = number
        say.publish(message)
        rclpy.spin_once(node, timeout_sec=0.005)
    met.until(lambda: False, 1.0)
    after = met.last["/haptigraph/needle_tip"].point
    return {"moved_mm": 1e3 * ((after.x - before.x) ** 2 + (after.y - before.y) ** 2) ** 0.5}


def echo(node):
    say, heard = node.create_publisher(JoyFeedback, "/back", 10), Counter()

    def back(message):
        heard["messages"] += message.intensity >= 0
        heard["end"] += message.intensity == 2.0
        say.publish(message)

    node.create_subscription(JoyFeedback, "/forth", back, 10)
    end_s = time.monotonic() + PATIENCE_S
    while not heard["end"] and time.monotonic() < end_s:
        rclpy.spin_once(node, timeout_sec=0.1)
    return {"heard": heard["messages"] - heard["end"]}


def main():
    role, *arguments = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node("haptigraph_interop")
    if role == "camera":
        result = camera(node, arguments[0], int(arguments[1]))
    else:
        result = {"stick": stick, "echo": echo}[role](node, *map(int, arguments))
    sys.stdout.write(json.dumps(result) + "\n")
    sys.stdout.flush()
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
