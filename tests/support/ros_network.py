"""A ROS 2 network of this machine alone: nobody else hears it, and two test runs never hear each other."""

import os
import queue
import subprocess
import sys
import threading
import uuid
from contextlib import contextmanager
from pathlib import Path

PEER_TIMEOUT_S = 30

# Type information is not compared, so that a peer may lie about what a message holds, as broken software does.
SETTINGS = """<CycloneDDS><Domain>
<General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces><AllowMulticast>false</AllowMulticast></General>
<Discovery>{tag}<Peers><Peer address="127.0.0.1"/></Peers><ParticipantIndex>auto</ParticipantIndex></Discovery>
<Compatibility><IgnoreTypeInformation>{ignored}</IgnoreTypeInformation></Compatibility>
</Domain></CycloneDDS>"""


def loopback(tag: str | None = None, ignored: str = "1.15,1.16") -> dict[str, str]:
    """The variables that keep DDS on this machine; with a tag, among those who know it."""
    told = SETTINGS.format(tag=f"<Tag>{tag}</Tag>" if tag else "", ignored=ignored)
    return {"ROS_DOMAIN_ID": str(1 + os.getpid() % 100), "CYCLONEDDS_URI": told.replace("\n", "")}


def tag() -> str:
    return f"haptigraph-{uuid.uuid4().hex}"


class Peer:
    """Another program on the network: hears topics, and says things on others."""

    def __init__(self):
        from haptigraph.ros2.node import Node

        self.node = Node()
        self.heard: dict[str, queue.Queue] = {}
        self.refused = []

    def hear(self, topic, message_type):
        self.heard[topic] = queue.Queue()
        self.node.subscribe(topic, message_type, self.heard[topic].put, self.refused.append)

    def next(self, topic, like=lambda message: True):
        """The next message on a topic that is like what is looked for."""
        while True:
            message = self.heard[topic].get(timeout=PEER_TIMEOUT_S)
            if like(message):
                return message

    def say(self, topic, message_type):
        """A publisher, once somebody hears it."""
        publisher = self.node.publisher(topic, message_type)
        until(lambda: publisher.has_listeners, f"nobody subscribes to {topic}")
        return publisher


def until(holds, limitations, timeout_s=PEER_TIMEOUT_S):
    tick = threading.Event()
    for _ in range(timeout_s * 100):
        if holds():
            return
        tick.wait(0.01)
    raise AssertionError(limitations)


@contextmanager
def running(*arguments, **environment):
    """`haptigraph run ...` in a process of its own; its output is in `process.told` once it was ended."""
    process = subprocess.Popen(
        [sys.executable, "-m", "haptigraph", "run", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, **environment},
    )
    process.told = ""
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.told += process.communicate(timeout=PEER_TIMEOUT_S)[0]
        finally:
            process.kill()


@contextmanager
def broken_program():
    """A program on the network that says nonsense on /text, /joy and /camera/image."""
    process = subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("ros_broken.py"))], stdout=subprocess.PIPE
    )
    try:
        assert process.stdout.readline() == b"saying\n"
        yield
    finally:
        process.kill()
        process.communicate()
