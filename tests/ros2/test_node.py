import os

import pytest
from ros_network import broken_program, until

pytest.importorskip("cyclonedds")

from cyclonedds.builtin import BuiltinTopicDcpsSubscription
from cyclonedds.topic import Topic

from haptigraph.errors import BadInput
from haptigraph.ros2.endpoints import Endpoints, sender
from haptigraph.ros2.node import Node, _Subscription, buffer_hint, checked_topic, domain_id
from haptigraph.ros2.qos import Profile
from haptigraph.ros2.services import CYCLONE
from haptigraph.ros2.types import Header, Image, Joy, String, Time


def test_messages_arrive_complete_and_in_order(peer):
    peer.subscribe("/numbers", String)
    publisher = peer.publisher("/numbers", String)
    for number in range(20):
        publisher.send(String(f"{number} \N{MICRO SIGN}m"))
        assert peer.next("/numbers").data == f"{number} \N{MICRO SIGN}m"


def test_an_image_of_megabytes_arrives_unchanged(peer):
    data = os.urandom(1280 * 720 * 3)
    peer.subscribe("/image", Image)
    publisher = peer.publisher("/image", Image)
    publisher.send(Image(Header(Time(3, 4), "camera"), 720, 1280, "bgr8", 0, 3840, data))
    image = peer.next("/image")
    assert (image.header.stamp.ns, image.width, image.height) == (3_000_000_004, 1280, 720)
    assert image.data == data


def test_a_subscriber_is_reliable_if_all_publishers_are(peer, ros_network, monkeypatch):
    endpoints = Endpoints(peer.node.participant, BuiltinTopicDcpsSubscription)
    node = Node()
    node.subscribe("/adapts", String, lambda message: None, print, is_large=True)
    until(lambda: "/adapts" in endpoints.topics(), "nobody subscribes")
    assert not endpoints.are_reliable("rt/adapts")  # so that it matches every publisher
    reliable = peer.publisher("/adapts", String)
    until(lambda: endpoints.are_reliable("rt/adapts"), "the subscriber does not adapt")
    best_effort = Profile(10, is_reliable=False)
    monkeypatch.setattr("haptigraph.ros2.node.publisher_profile", lambda topic: best_effort)
    peer.publisher("/adapts", String)
    until(lambda: not endpoints.are_reliable("rt/adapts"), "the second publisher would not be heard")
    assert reliable.has_subscribers
    endpoints.close()
    node.close()


def test_a_message_that_has_arrived_survives_the_change_to_reliable(peer, ros_network):
    node = Node()
    topic = Topic(node.participant, "rt/adapts", String)
    subscription = _Subscription(node.participant, topic, Profile(2, is_reliable=False), is_large=True)
    peer.publisher("/adapts", String).send(String("first"))
    until(lambda: "/adapts" in node.published(), "the publisher is not discovered")
    subscription.wait()
    assert [message.data for message in subscription.take()] == ["first"]
    subscription.wait()
    assert subscription._profile.is_reliable
    node.close()


@pytest.mark.parametrize(("limit", "hint"), [("212992\n", "208 KiB"), ("4194304\n", ""), ("odd", "")])
def test_a_small_receive_buffer_is_explained(monkeypatch, tmp_path, limit, hint):
    (tmp_path / "rmem_max").write_text(limit)
    monkeypatch.setattr("haptigraph.ros2.node.KERNEL_LIMIT", tmp_path / "rmem_max")
    assert bool(buffer_hint()) is bool(hint)
    assert hint in buffer_hint()
    monkeypatch.setattr("haptigraph.ros2.node.KERNEL_LIMIT", tmp_path / "none")
    assert buffer_hint() == ""


def test_an_undecodable_message_is_rejected_and_the_next_is_received(peer):
    peer.subscribe("/text", String)
    peer.subscribe("/joy", Joy)
    with broken_program():
        assert peer.next("/text").data == "fine"
        for _ in range(4):  # only well-formed ones arrive
            assert len(peer.next("/joy").axes) < 10
        until(
            lambda: any("can't decode byte 0xff" in problem for problem in peer.rejected),
            "nothing was rejected",
        )


def test_a_callback_that_raises_receives_the_next_message(ros_network):
    node, received, rejected = Node(), [], []

    def take(message):
        if message.data == "bad":
            raise ValueError("no such thing")
        received.append(message.data)

    node.subscribe("/picky", String, take, rejected.append)
    publisher = node.publisher("/picky", String)
    until(lambda: publisher.has_subscribers, "no subscriber")
    for text in ("bad", "good"):
        publisher.send(String(text))
    until(lambda: received, "nothing was received")
    node.close()
    assert (received, rejected) == (["good"], ["no such thing"])


def test_topics_are_discovered_with_their_types_and_disappear_with_their_node(peer):
    other = Node()
    other.publisher("/somewhere/text", String)
    until(lambda: "/somewhere/text" in peer.node.published(), "the topic is not discovered")
    assert peer.node.published()["/somewhere/text"] == "std_msgs::msg::dds_::String_"
    other.close()
    until(lambda: "/somewhere/text" not in peer.node.published(), "the topic stays")


def test_the_last_message_of_a_node_is_received(peer):
    peer.subscribe("/will", String)
    for number in range(20):
        other = Node()
        publisher = other.publisher("/will", String)
        until(lambda publisher=publisher: publisher.has_subscribers, "no subscriber")
        publisher.send(String(f"the end {number}"))
        other.close()
        assert peer.next("/will").data == f"the end {number}"
    assert peer.rejected == []


def test_a_closed_node_cannot_publish(ros_network):
    node = Node()
    publisher = node.publisher("/silent", String)
    node.close()
    node.close()
    assert not publisher.has_subscribers
    with pytest.raises(OSError, match="/silent is closed"):
        publisher.send(String("x"))


@pytest.mark.parametrize("name", ["", "/", "a//b", "a b", "1a", "a-b", "a/", "../a"])
def test_an_invalid_topic_name_is_rejected(name):
    with pytest.raises(BadInput, match="is no ROS topic; expected names of letters"):
        checked_topic(name)


def test_a_topic_name_gets_a_leading_slash():
    assert checked_topic("camera/image_raw") == checked_topic("/camera/image_raw") == "/camera/image_raw"


@pytest.mark.parametrize(("value", "domain"), [("", 0), ("0", 0), (" 42 ", 42), ("232", 232)])
def test_the_domain_is_read_from_ros_domain_id(monkeypatch, value, domain):
    monkeypatch.setenv("ROS_DOMAIN_ID", value)
    assert domain_id() == domain


@pytest.mark.parametrize("value", ["-1", "233", "lab", "1.5"])
def test_an_invalid_domain_is_rejected(monkeypatch, value):
    monkeypatch.setenv("ROS_DOMAIN_ID", value)
    with pytest.raises(BadInput, match="expected a number from 0 to 232"):
        domain_id()


def test_endpoints_of_a_topic_have_types_and_qualities(peer, ros_network):
    node = Node()
    node.publisher("/tf_static", Joy)  # transient local, by its name
    node.publisher("/ends", String)
    node.subscribe("/ends", String, print, print)
    static = ("rt/tf_static", "sensor_msgs::msg::dds_::Joy_", True, True, CYCLONE)
    until(lambda: static in peer.node.publishers("/tf_static"), "a transient local publisher is not found")
    until(lambda: peer.node.publishers("/ends") and peer.node.subscribers("ends"), "nothing is found")
    (plain,) = peer.node.publishers("/ends")
    assert (plain.is_reliable, plain.is_transient_local) == (True, False)
    assert not peer.node.subscribers("/ends")[0].is_reliable
    assert peer.node.publishers("/nothing") == []
    node.close()


def test_a_latched_subscription_receives_what_was_sent_before(ros_network):
    early, late, received = Node(), Node(), []
    early.publisher("/tf_static", String).send(String("before"))
    late.subscribe("/tf_static", String, received.append, print, is_latched=True)
    until(lambda: received, "nothing was received")
    assert received == [String("before")]
    for node in (early, late):
        node.close()


def test_messages_of_two_publishers_are_distinguished(peer, ros_network):
    peer.subscribe("/two", String)
    publishers = [peer.publisher("/two", String) for _ in range(2)]
    senders = set()
    for number in (0, 1, 0, 1):
        publishers[number].send(String(str(number)))
        message = peer.next("/two")
        senders.add((message.data, sender(message)))
    assert sorted(data for data, _ in senders) == ["0", "1"]
    assert len({number for _, number in senders}) == 2
