"""Publish raw images of random bytes, 30 a second: WIDTH HEIGHT RELIABILITY COUNT."""

import os
import sys
import time

from cyclonedds.qos import Policy, Qos
from cyclonedds.util import duration

from haptigraph.ros2 import node, types

ADAPTS_S = 2.0  # so that the subscriber knows this publisher before the first image


def main(width, height, reliability, count):
    reliable = Policy.Reliability.Reliable(duration(milliseconds=100))
    kind = reliable if reliability == "reliable" else Policy.Reliability.BestEffort
    node.PUBLISHER_QOS = Qos(kind, Policy.History.KeepLast(10))
    here = node.Node()
    publisher = here.publisher("/camera/image_raw", types.Image)
    while not publisher.has_subscribers:
        time.sleep(0.05)
    data, begin_s = os.urandom(3 * width * height), time.monotonic() + ADAPTS_S
    for number in range(count):
        time.sleep(max(begin_s + number / 30 - time.monotonic(), 0))
        stamp = types.Time(*divmod(time.time_ns(), 10**9))
        publisher.send(types.Image(types.Header(stamp, "camera"), height, width, "bgr8", 0, 3 * width, data))
    time.sleep(1.0)
    here.close()


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], int(sys.argv[4]))
