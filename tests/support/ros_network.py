"""A ROS 2 network limited to this machine and to one test run."""

import os
import queue
import subprocess
import sys
import threading
import uuid
from contextlib import contextmanager
from pathlib import Path

PEER_TIMEOUT_S = 30

# Type information is not compared, so that a peer may misdeclare its messages, as broken software does.
SETTINGS = """<CycloneDDS><Domain>
<General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces><AllowMulticast>false</AllowMulticast></General>
<Discovery>{tag}<Peers><Peer address="127.0.0.1"/></Peers><ParticipantIndex>auto</ParticipantIndex></Discovery>
<Compatibility><IgnoreTypeInformation>{ignored}</IgnoreTypeInformation></Compatibility>
</Domain></CycloneDDS>"""


def loopback(tag: str | None = None, ignored: str = "1.15,1.16") -> dict[str, str]:
    """The environment variables that keep DDS on this machine, and among participants with the same tag."""
    settings = SETTINGS.format(tag=f"<Tag>{tag}</Tag>" if tag else "", ignored=ignored)
    return {"ROS_DOMAIN_ID": str(1 + os.getpid() % 100), "CYCLONEDDS_URI": settings.replace("\n", "")}


def rclpy_environment() -> dict[str, str]:
    """The environment variables of a real ROS 2 node on the network of this process."""
    own = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "CYCLONEDDS_URI")}
    return own | {"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


def tag() -> str:
    return f"haptigraph-{uuid.uuid4().hex}"


class Peer:
    """Another participant: subscribes to topics and publishes on others."""

    def __init__(self):
        from haptigraph.ros2.node import Node

        self.node = Node()
        self.received: dict[str, queue.Queue] = {}
        self.rejected = []

    def subscribe(self, topic, message_type):
        self.received[topic] = queue.Queue()
        self.node.subscribe(topic, message_type, self.received[topic].put, self.rejected.append)

    def next(self, topic, matches=lambda message: True):
        """The next message on a topic that matches."""
        while True:
            message = self.received[topic].get(timeout=PEER_TIMEOUT_S)
            if matches(message):
                return message

    def publisher(self, topic, message_type):
        """A publisher, once it has a subscriber."""
        publisher = self.node.publisher(topic, message_type)
        until(lambda: publisher.has_subscribers, f"no subscriber of {topic}")
        return publisher


def until(holds, problem, timeout_s=PEER_TIMEOUT_S):
    tick = threading.Event()
    for _ in range(timeout_s * 100):
        if holds():
            return
        tick.wait(0.01)
    raise AssertionError(problem)


@contextmanager
def running(*arguments, **environment):
    """`haptigraph run ...` in another process; `process.output` is complete after the block."""
    process = subprocess.Popen(
        [sys.executable, "-m", "haptigraph", "run", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, **environment},
    )
    process.output = ""
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.output += process.communicate(timeout=PEER_TIMEOUT_S)[0]
        finally:
            process.kill()


@contextmanager
def broken_program():
    """A program that publishes invalid messages on /text, /joy and /camera/image."""
    process = subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("ros_broken.py"))], stdout=subprocess.PIPE
    )
    try:
        assert process.stdout.readline() == b"publishing\n"
        yield
    finally:
        process.kill()
        process.communicate()


@contextmanager
def robot_peer(kind, *arguments):
    """A simulated robot in another process: crtk_peer.py or servo_peer.py. Its standard input takes commands."""
    process = subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("robots") / f"{kind}_peer.py"), *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        bufsize=1,
    )
    try:
        assert process.stdout.readline() == "ready\n"
        yield process
    finally:
        process.kill()
        process.communicate()
