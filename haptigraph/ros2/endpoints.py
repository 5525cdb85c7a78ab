"""Who publishes and subscribes on a DDS network."""

from typing import Any, NamedTuple

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopic
from cyclonedds.core import InstanceState, Policy
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct

__all__ = ["Endpoint", "Endpoints", "sender"]


class Endpoint(NamedTuple):
    """One publication, or subscription, on the network."""

    topic: str
    """Its DDS name."""
    type_name: str
    is_reliable: bool
    is_transient_local: bool
    vendor: bytes
    """Of its middleware: the first two bytes of its participant's GUID."""


class Endpoints:
    """The publications, or subscriptions, on the network.

    Args:
        participant: The participant that listens.
        topic: Cyclone's topic of publications or of subscriptions.
    """

    def __init__(self, participant: DomainParticipant, topic: BuiltinTopic) -> None:
        self._reader: BuiltinDataReader | None = BuiltinDataReader(participant, topic)
        self._seen: dict[Any, Endpoint] = {}

    def topics(self) -> dict[str, str]:
        """Return ROS name and DDS name of the type of each topic."""
        self._update()
        seen = [endpoint for endpoint in self._seen.values() if endpoint.topic[:3] == "rt/"]
        return dict(sorted((endpoint.topic.removeprefix("rt"), endpoint.type_name) for endpoint in seen))

    def of(self, topic: str) -> list[Endpoint]:
        """Return the endpoints of a topic (DDS name)."""
        self._update()
        return [endpoint for endpoint in self._seen.values() if endpoint.topic == topic]

    def are_reliable(self, topic: str) -> bool:
        """Return whether a topic has endpoints, and all of them are reliable."""
        endpoints = self.of(topic)
        return bool(endpoints) and all(endpoint.is_reliable for endpoint in endpoints)

    def _update(self) -> None:
        for sample in self._reader.take(N=1000) if self._reader else ():
            if sample.sample_info.instance_state == InstanceState.Alive:
                is_reliable = isinstance(sample.qos[Policy.Reliability], Policy.Reliability.Reliable)
                is_local = sample.qos[Policy.Durability] == Policy.Durability.TransientLocal
                self._seen[sample.key] = Endpoint(
                    sample.topic_name,
                    sample.type_name,
                    is_reliable,
                    is_local,
                    sample.participant_key.bytes[:2],
                )
            else:
                self._seen.pop(sample.key, None)

    def close(self) -> None:
        """Stop listening."""
        self._reader = None


def sender(message: IdlStruct) -> int:
    """Return a number that identifies the publisher of a received message."""
    handle: int = message.sample_info.publication_handle  # type: ignore[attr-defined]
    return handle
