"""Publish and subscribe as a ROS 2 node does, over plain DDS. Knows topics and messages, not what they mean.

ROS's own variables say which network: ROS_DOMAIN_ID the domain, CYCLONEDDS_URI how to reach it. They are read
because every other ROS program of a lab reads them.
"""

import os
import re
import threading
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopic,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.core import (
    DDSException,
    InstanceState,
    Policy,
    Qos,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from haptigraph.errors import BadInput

__all__ = ["Node", "Publisher", "checked_topic", "domain_id"]

M = TypeVar("M", bound=IdlStruct)

# eProsima's type objects hold what Cyclone refuses, so that types with sequences would not match
# (https://github.com/eclipse-cyclonedds/cyclonedds/pull/2333). ROS agrees on types by their names anyway.
COMPATIBLE = (
    "<CycloneDDS><Domain><Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation>"
    "</Compatibility></Domain></CycloneDDS>"
)
MOST_DOMAIN = 232
# Reliable, so that it matches every subscriber. cyclonedds holds Python's lock while a write waits for slow
# readers, so it may not wait; with a short history it need not.
SENT = Qos(Policy.Reliability.Reliable(duration(milliseconds=1)), Policy.History.KeepLast(10))
DEPTH = 64
LOOK_NS = duration(milliseconds=100)  # how often a subscriber looks whether it is to end
CLOSE_TIMEOUT_S = 1.0


class Publisher:
    """Publish messages of one type on one topic.

    Args:
        participant: Who publishes.
        topic: ROS name of the topic.
        message_type: Type of its messages.
    """

    def __init__(self, participant: DomainParticipant, topic: str, message_type: type[IdlStruct]) -> None:
        self._topic = checked_topic(topic)
        self._writer: DataWriter[Any] | None = DataWriter(
            participant, Topic(participant, f"rt{self._topic}", message_type), qos=SENT
        )

    def send(self, message: IdlStruct) -> None:
        """Publish one message; returns within milliseconds.

        Raises:
            OSError: If it could not be handed to the network.
        """
        if self._writer is None:
            raise OSError(f"{self._topic} is closed")
        try:
            self._writer.write(message)
        except DDSException as error:
            raise OSError(error.msg) from None

    @property
    def has_listeners(self) -> bool:
        """Whether anybody subscribes at this moment."""
        return self._writer is not None and bool(self._writer.get_matched_subscriptions())

    def close(self) -> None:
        """Publish no more. May be called twice."""
        self._writer = None


class Node:
    """One participant of a ROS 2 network.

    Args:
        domain: The ROS domain; None: as ROS_DOMAIN_ID says, or else 0.

    Raises:
        BadInput: If the domain or the network's settings cannot be used.
    """

    def __init__(self, domain: int | None = None) -> None:
        self.domain = domain_id() if domain is None else domain
        try:
            _begun(self.domain)
            self._participant: DomainParticipant | None = DomainParticipant(self.domain)
        except DDSException as error:
            raise BadInput(
                f"DDS domain {self.domain} cannot be joined ({error.msg}); is CYCLONEDDS_URI right?"
            ) from None
        self._closing = threading.Event()
        self._threads: list[threading.Thread] = []
        self._publishers: list[Publisher] = []
        self._publications = _Endpoints(self._joined, BuiltinTopicDcpsPublication)
        self._subscriptions = _Endpoints(self._joined, BuiltinTopicDcpsSubscription)

    def publisher(self, topic: str, message_type: type[IdlStruct]) -> Publisher:
        """Return a publisher for a topic."""
        self._publishers.append(Publisher(self._joined, topic, message_type))
        return self._publishers[-1]

    def subscribe(
        self,
        topic: str,
        message_type: type[M],
        take: Callable[[M], None],
        refuse: Callable[[str], None],
        *,
        depth: int = DEPTH,
    ) -> None:
        """Have every message of a topic taken, in a thread of its own.

        Args:
            topic: ROS name of the topic.
            message_type: Type of its messages; others on the topic are not received.
            take: Called with every message.
            refuse: Called with what is wrong with a message that cannot be decoded or taken.
            depth: How many may wait to be taken; of more, the oldest are lost.
        """
        # Best effort, so that it matches every publisher; what is late is not worth having.
        sensed = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(depth))
        there = Topic(self._joined, f"rt{checked_topic(topic)}", message_type)
        reader = DataReader(self._joined, there, qos=sensed)
        thread = threading.Thread(
            target=self._receive, args=(reader, take, refuse), name=f"haptigraph-ros2-{topic}", daemon=True
        )
        self._threads.append(thread)
        thread.start()

    def published(self) -> dict[str, str]:
        """Return which topics are published on the network, by ROS name, and the DDS name of their types."""
        return self._publications.topics()

    def subscribed(self) -> dict[str, str]:
        """Return which topics are subscribed to, as `published` does."""
        return self._subscriptions.topics()

    def close(self) -> None:
        """Leave the network. May be called twice."""
        self._closing.set()
        for thread in self._threads:
            thread.join(CLOSE_TIMEOUT_S)
        for publisher in self._publishers:
            publisher.close()
        self._publications.close()
        self._subscriptions.close()
        self._participant = None  # cyclonedds lets go of what nobody holds

    @property
    def _joined(self) -> DomainParticipant:
        if self._participant is None:
            raise ValueError("the node is closed")
        return self._participant

    def _receive(
        self, reader: DataReader[M], take: Callable[[M], None], refuse: Callable[[str], None]
    ) -> None:
        waitset = WaitSet(self._joined)
        # Of any state: the last words of a node that has left are words, too.
        fresh = ReadCondition(reader, ViewState.Any | InstanceState.Any | SampleState.NotRead)
        waitset.attach(fresh)
        while not self._closing.is_set():
            try:
                waitset.wait(LOOK_NS)
                while not self._closing.is_set() and (messages := reader.take(N=1, condition=fresh)):
                    if not isinstance(messages[0], InvalidSample):  # which tells of a node that has left
                        take(messages[0])
            except Exception as error:  # whatever the network sends must not end this thread
                refuse(str(error) or type(error).__name__)


class _Endpoints:
    """Who publishes, or subscribes to, what on the network."""

    def __init__(self, participant: DomainParticipant, told_by: BuiltinTopic) -> None:
        self._reader: BuiltinDataReader | None = BuiltinDataReader(participant, told_by)
        self._seen: dict[Any, tuple[str, str]] = {}

    def topics(self) -> dict[str, str]:
        for sample in self._reader.take(N=1000) if self._reader else ():
            if sample.sample_info.instance_state == InstanceState.Alive:
                self._seen[sample.key] = sample.topic_name, sample.type_name
            else:
                self._seen.pop(sample.key, None)
        topics = [(name.removeprefix("rt"), kind) for name, kind in self._seen.values() if name[:3] == "rt/"]
        return dict(sorted(topics))

    def close(self) -> None:
        self._reader = None


def domain_id() -> int:
    """Return the ROS domain of this machine: ROS_DOMAIN_ID, or else 0.

    Raises:
        BadInput: If it is no domain.
    """
    text = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not text.isdecimal() or int(text) > MOST_DOMAIN:
        raise BadInput(f"found {text!r}; expected a number from 0 to {MOST_DOMAIN}", "ROS_DOMAIN_ID")
    return int(text)


def checked_topic(name: str) -> str:
    """Return a topic's full ROS name, with a slash in front.

    Raises:
        BadInput: If it is no name of a topic.
    """
    full = name if name.startswith("/") else f"/{name}"
    if not re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", full):
        raise BadInput(
            f"{name!r} is no ROS topic; expected names of letters, digits and _ with / between, for example "
            "/camera/image_raw"
        )
    return full


@cache
def _begun(domain: int) -> Domain:
    """Configure a domain, once in a process: DDS has no second configuration of a domain, and no undoing."""
    theirs = os.environ.get("CYCLONEDDS_URI", "")
    return Domain(domain, f"{COMPATIBLE},{theirs}" if theirs else COMPATIBLE)
