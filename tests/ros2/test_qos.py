import pytest
from paths import ROOT
from ros_network import until

pytest.importorskip("cyclonedds")

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import Policy

from haptigraph.ros2.node import Node
from haptigraph.ros2.qos import DEPTH, IMAGE_DEPTH, Profile, publisher_profile, subscriber_profile
from haptigraph.ros2.types import String


def documented():
    """The rows of the table in docs/reference/bridges.md."""
    text = (ROOT / "docs/reference/bridges.md").read_text()
    table = text.partition("**Quality of service.**")[2].partition("**Who finds whom.**")[0]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in table.splitlines()
        if line[:2] == "| "
    ]
    return {(topic.strip("`"), role): cells for topic, role, *cells in rows[1:]}


@pytest.mark.parametrize(
    ("topic", "role", "profile"),
    [
        ("/tf", "published", publisher_profile("/tf")),
        ("/tf_static", "published", publisher_profile("/tf_static")),
        ("all others", "published", publisher_profile("/haptigraph/state")),
        ("images", "subscribed", subscriber_profile("/camera/image", IMAGE_DEPTH)),
        ("/joy", "subscribed", subscriber_profile("/joy", DEPTH)),
    ],
)
def test_the_documented_quality_of_service_is_that_of_the_code(topic, role, profile):
    reliability, durability, depth = documented()[topic, role]
    assert reliability.partition(";")[0] == ("reliable" if profile.is_reliable else "best effort")
    assert durability == ("transient local" if profile.is_transient_local else "volatile")
    assert depth == str(profile.depth)


def test_every_row_of_the_table_is_compared():
    assert len(documented()) == 5


def test_a_topic_is_published_with_its_profile(peer):
    reader = BuiltinDataReader(peer.node.participant, BuiltinTopicDcpsPublication)
    other = Node()
    topics = ("/tf_static", "/tf", "/elsewhere")
    for topic in topics:
        other.publisher(topic, String)
    found = {}

    def all_found():
        found.update((sample.topic_name.removeprefix("rt"), sample.qos) for sample in reader.take(N=100))
        return set(topics) <= set(found)

    until(all_found, "the topics are not discovered")
    for topic in topics:
        profile, qos = publisher_profile(topic), found[topic]
        assert isinstance(qos[Policy.Reliability], Policy.Reliability.Reliable)
        assert (qos[Policy.Durability] == Policy.Durability.TransientLocal) is profile.is_transient_local
    other.close()


def test_a_later_subscriber_receives_static_transforms_only(peer, ros_network):
    other = Node()
    for topic in ("/tf_static", "/elsewhere"):
        other.publisher(topic, String).send(String("before"))
    for topic in ("/tf_static", "/elsewhere"):
        peer.subscribe(topic, String)
    later = other._publishers[1]
    until(lambda: later.has_subscribers, "no subscriber")
    later.send(String("after"))
    assert peer.next("/tf_static").data == "before"
    assert peer.next("/elsewhere").data == "after"
    other.close()


def test_subscriptions_match_every_publisher_unless_they_need_what_was_sent_before():
    assert subscriber_profile("/any") == Profile(DEPTH, is_reliable=False)
    assert subscriber_profile("/tf_static").is_transient_local
