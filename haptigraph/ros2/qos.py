"""The quality of service of every ROS 2 topic; a test keeps docs/reference/bridges.md consistent with it."""

from typing import NamedTuple

from cyclonedds.core import Policy, Qos
from cyclonedds.util import duration

__all__ = ["DEPTH", "IMAGE_DEPTH", "SERVICE", "Profile", "publisher_profile", "subscriber_profile"]

DEPTH = 64
"""Of a subscription: messages that wait; if there are more, the oldest are lost."""
IMAGE_DEPTH = 2
"""Of a subscription to images."""


class Profile(NamedTuple):
    """A quality of service, in ROS's terms; history is keep last."""

    depth: int
    is_reliable: bool = True
    is_transient_local: bool = False
    """Whether subscribers that come later receive the last messages, too; else it is volatile."""

    @property
    def qos(self) -> Qos:
        """The same as DDS policies."""
        # cyclonedds holds the GIL while a write waits for slow readers, so writes must not wait; with a short
        # history they need not.
        reliable = Policy.Reliability.Reliable(duration(milliseconds=1))
        local = Policy.Durability.TransientLocal
        return Qos(
            reliable if self.is_reliable else Policy.Reliability.BestEffort,
            local if self.is_transient_local else Policy.Durability.Volatile,
            Policy.History.KeepLast(self.depth),
        )


PUBLISHED = Profile(10)  # reliable, so that it matches every subscriber
SERVICE = Profile(10)
"""Of requests to services, and replies."""
TF = Profile(100)
"""Of /tf, as its broadcasters and listeners in ROS."""
TF_STATIC = Profile(1, is_transient_local=True)
TF_STATIC_SUBSCRIBED = Profile(100, is_transient_local=True)


def publisher_profile(topic: str) -> Profile:
    """Return the profile with which a topic (full ROS name) is published."""
    return {"/tf": TF, "/tf_static": TF_STATIC}.get(topic, PUBLISHED)


def subscriber_profile(topic: str, depth: int = DEPTH) -> Profile:
    """Return the profile with which a topic (full ROS name) is subscribed: one that matches every publisher.

    Those of /tf and /tf_static match ROS's broadcasters, which are reliable. Publishers of /tf_static are
    transient local; only such a subscription receives what they sent before.
    """
    special = {"/tf": TF, "/tf_static": TF_STATIC_SUBSCRIBED}
    return special.get(topic, Profile(depth, is_reliable=False))
