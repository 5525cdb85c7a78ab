"""Publish and subscribe like a ROS 2 node, over plain DDS.

The environment variables are those of other ROS programs: ROS_DOMAIN_ID selects the domain,
ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_STATIC_PEERS the nodes that are found (`discovery`), CYCLONEDDS_URI
configures the network.
"""

import os
import re
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from cyclonedds.builtin import BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.core import (
    DDSException,
    InstanceState,
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
from haptigraph.ros2.discovery import discovery_settings
from haptigraph.ros2.endpoints import Endpoint, Endpoints
from haptigraph.ros2.qos import DEPTH, Profile, publisher_profile, subscriber_profile

__all__ = ["Node", "Publisher", "buffer_hint", "checked_topic", "domain_id"]

M = TypeVar("M", bound=IdlStruct)

# Cyclone rejects parts of eProsima's type objects, so that types with sequences would not match
# (https://github.com/eclipse-cyclonedds/cyclonedds/pull/2333). ROS matches types by their names anyway.
# A raw image of 1280 x 720 px has 43 packets: the default receive buffer overflows before they are read.
RECEIVE_BUFFER_BYTES = 4 * 1024**2
SETTINGS = (
    "<CycloneDDS><Domain><Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation></Compatibility>"
    f'<Internal><SocketReceiveBufferSize max="{RECEIVE_BUFFER_BYTES}B"/></Internal></Domain></CycloneDDS>'
)
KERNEL_LIMIT = Path("/proc/sys/net/core/rmem_max")
MAX_DOMAIN = 232
WAIT_NS = duration(milliseconds=100)  # between a subscriber's checks whether to end
CHECK_S = 0.5  # between checks of the publishers
CLOSE_TIMEOUT_S = 1.0
TICK_S = 0.02  # between checks of the subscribers


class Publisher:
    """Publish messages of one type on one topic.

    Args:
        participant: The publishing participant.
        topic: ROS name of the topic.
        message_type: Type of its messages.
    """

    def __init__(self, participant: DomainParticipant, topic: str, message_type: type[IdlStruct]) -> None:
        self._topic = checked_topic(topic)
        self._writer: DataWriter[Any] | None = DataWriter(
            participant,
            Topic(participant, f"rt{self._topic}", message_type),
            qos=publisher_profile(self._topic).qos,
        )

    def send(self, message: IdlStruct) -> None:
        """Publish one message; returns within milliseconds.

        Raises:
            OSError: If it could not be sent.
        """
        if self._writer is None:
            raise OSError(f"{self._topic} is closed")
        try:
            self._writer.write(message)
        except DDSException as error:
            raise OSError(error.msg) from None

    @property
    def has_subscribers(self) -> bool:
        """Whether the topic has subscribers now."""
        if self._writer is None:
            return False
        # Not get_matched_subscriptions: it fails if a subscriber comes while it counts.
        status = self._writer.get_publication_matched_status()  # type: ignore[no-untyped-call]
        return bool(status.current_count)

    def close(self) -> None:
        """Stop publishing. May be called twice."""
        self._writer = None


class Node:
    """One participant of a ROS 2 network.

    Args:
        domain: The ROS domain; None: ROS_DOMAIN_ID, or else 0.

    Raises:
        BadInput: If the domain or the network configuration is not valid.
    """

    def __init__(self, domain: int | None = None) -> None:
        self.domain = domain_id() if domain is None else domain
        try:
            _configured(self.domain)
            self._participant: DomainParticipant | None = DomainParticipant(self.domain)
        except DDSException as error:
            raise BadInput(
                f"DDS domain {self.domain} cannot be joined ({error.msg}); check CYCLONEDDS_URI, or whether "
                "too many ROS nodes run on this machine"
            ) from None
        self._closing = threading.Event()
        self._threads: list[threading.Thread] = []
        self._publishers: list[Publisher] = []
        self._publications = Endpoints(self.participant, BuiltinTopicDcpsPublication)
        self._subscriptions = Endpoints(self.participant, BuiltinTopicDcpsSubscription)

    def publisher(self, topic: str, message_type: type[IdlStruct]) -> Publisher:
        """Return a publisher for a topic."""
        self._publishers.append(Publisher(self.participant, topic, message_type))
        return self._publishers[-1]

    def subscribe(
        self,
        topic: str,
        message_type: type[M],
        take: Callable[[M], None],
        reject: Callable[[str], None],
        *,
        depth: int = DEPTH,
        is_large: bool = False,
        is_latched: bool = False,
    ) -> None:
        """Pass every message of a topic to a callback, in a thread of its own.

        Args:
            topic: ROS name of the topic.
            message_type: Type of its messages; others on the topic are not received.
            take: Called with every message.
            reject: Called with the problem of a message that cannot be decoded, or for which `take` raises.
            depth: Length of the queue; if it is full, the oldest messages are lost.
            is_large: Whether messages have many packets. If all publishers are reliable, lost ones are sent
                again; the first messages may be lost while the subscription adapts.
            is_latched: Receive also what publishers that are transient local sent before, and only these
                publishers.
        """
        name = checked_topic(topic)
        dds_topic = Topic(self.participant, f"rt{name}", message_type)
        profile = Profile(depth, is_transient_local=True) if is_latched else subscriber_profile(name, depth)
        subscription = _Subscription(self.participant, dds_topic, profile, is_large=is_large)
        thread = threading.Thread(
            target=self._receive,
            args=(subscription, take, reject),
            name=f"haptigraph-ros2-{topic}",
            daemon=True,
        )
        self._threads.append(thread)
        thread.start()

    def await_subscribers(self, within_s: float) -> None:
        """Wait, but not longer than stated, until every topic of this node has a subscriber."""
        tick = threading.Event()
        for _ in range(round(within_s / TICK_S)):
            if all(publisher.has_subscribers for publisher in self._publishers):
                return
            tick.wait(TICK_S)

    def published(self) -> dict[str, str]:
        """Return the published topics of the network: ROS name and DDS name of the type."""
        return self._publications.topics()

    def subscribed(self) -> dict[str, str]:
        """Return the subscribed topics of the network, like `published`."""
        return self._subscriptions.topics()

    def publishers(self, topic: str) -> list[Endpoint]:
        """Return the publishers of a topic (ROS name)."""
        return self._publications.of(f"rt{checked_topic(topic)}")

    def subscribers(self, topic: str) -> list[Endpoint]:
        """Return the subscribers of a topic (ROS name)."""
        return self.dds_subscribers(f"rt{checked_topic(topic)}")

    def dds_subscribers(self, name: str) -> list[Endpoint]:
        """Return the subscribers of a topic (DDS name)."""
        return self._subscriptions.of(name)

    def close(self) -> None:
        """Leave the network. May be called twice."""
        self._closing.set()
        for thread in self._threads:
            thread.join(CLOSE_TIMEOUT_S)
        for publisher in self._publishers:
            publisher.close()
        self._publications.close()
        self._subscriptions.close()
        self._participant = None  # cyclonedds frees a participant that is not referenced

    @property
    def participant(self) -> DomainParticipant:
        """The participant, while the node is open."""
        if self._participant is None:
            raise ValueError("the node is closed")
        return self._participant

    def _receive(
        self, subscription: "_Subscription", take: Callable[[Any], None], reject: Callable[[str], None]
    ) -> None:
        while not self._closing.is_set():
            try:
                subscription.wait()
                while not self._closing.is_set() and (messages := subscription.take()):
                    if not isinstance(messages[0], InvalidSample):  # which announces that a node has left
                        take(messages[0])
            except Exception as error:  # no message may end this thread
                reject(str(error) or type(error).__name__)


class _Subscription:
    """A reader of one topic. If its messages are large, it is reliable as long as all publishers are."""

    def __init__(
        self, participant: DomainParticipant, topic: "Topic[Any]", profile: Profile, *, is_large: bool
    ) -> None:
        self._participant, self._topic, self._profile = participant, topic, profile
        self._publications = Endpoints(participant, BuiltinTopicDcpsPublication) if is_large else None
        self._check_at_s = 0.0
        self._open(profile)

    def wait(self) -> None:
        """Wait for a message, for a short time; adapt to the publishers now and then."""
        now_s = time.monotonic()
        # Messages in a reader are lost with it, so it is replaced while it has none.
        if self._publications is not None and now_s >= self._check_at_s and not self._waitset.wait(0):
            self._check_at_s = now_s + CHECK_S
            is_reliable = self._publications.are_reliable(self._topic.name)
            if is_reliable != self._profile.is_reliable:
                self._open(self._profile._replace(is_reliable=is_reliable))
        self._waitset.wait(WAIT_NS)

    def take(self) -> list[Any]:
        """Return the oldest message that was not taken yet, if any."""
        return self._reader.take(N=1, condition=self._unread)

    def _open(self, profile: Profile) -> None:
        self._profile = profile
        self._reader: DataReader[Any] = DataReader(self._participant, self._topic, qos=profile.qos)
        # In any instance state, for the last messages of a node that has left.
        self._unread = ReadCondition(self._reader, ViewState.Any | InstanceState.Any | SampleState.NotRead)
        self._waitset = WaitSet(self._participant)
        self._waitset.attach(self._unread)


def domain_id() -> int:
    """Return the ROS domain of this machine: ROS_DOMAIN_ID, or else 0.

    Raises:
        BadInput: If the variable is not a valid domain.
    """
    text = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not text.isdecimal() or int(text) > MAX_DOMAIN:
        raise BadInput(f"found {text!r}; expected a number from 0 to {MAX_DOMAIN}", "ROS_DOMAIN_ID")
    return int(text)


def checked_topic(name: str) -> str:
    """Return a topic's full ROS name, with a slash in front.

    Raises:
        BadInput: If it is not a valid name.
    """
    full = name if name.startswith("/") else f"/{name}"
    if not re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", full):
        raise BadInput(
            f"{name!r} is no ROS topic; expected names of letters, digits and _ with / between, for example "
            "/camera/image_raw"
        )
    return full


@cache
def _configured(domain: int) -> Domain:
    """Configure a domain, once per process: DDS cannot configure a domain again.

    The user's own settings come last and prevail.
    """
    settings = (SETTINGS, discovery_settings(), os.environ.get("CYCLONEDDS_URI", ""))
    return Domain(domain, ",".join(filter(None, settings)))


def buffer_hint() -> str:
    """Return how to permit a receive buffer that is large enough for raw images; empty if it is (Linux)."""
    with suppress(OSError, ValueError):
        limit_bytes = int(KERNEL_LIMIT.read_text())
        if limit_bytes < RECEIVE_BUFFER_BYTES:
            return (
                f"the kernel limits receive buffers to {limit_bytes // 1024} KiB, so raw images may be lost; "
                f"sudo sysctl -w net.core.rmem_max={RECEIVE_BUFFER_BYTES}"
            )
    return ""
