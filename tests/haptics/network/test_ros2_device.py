import pytest
from ros_network import until

pytest.importorskip("cyclonedds")

from haptigraph.errors import BadInput, DeviceError
from haptigraph.haptics.network import ros2
from haptigraph.haptics.network.ros2 import Ros2Device
from haptigraph.ros2.types import JoyFeedback, String


@pytest.fixture
def without_discovery(monkeypatch):
    """Do not wait for subscribers."""
    monkeypatch.setattr(ros2, "DISCOVERY_S", 0.0)


@pytest.fixture
def device(ros_network, without_discovery):
    device = Ros2Device("hand/set_feedback")
    yield device
    device.close()


def test_every_amplitude_arrives(device, peer):
    peer.subscribe("/hand/set_feedback", JoyFeedback)
    until(lambda: device._publisher.has_subscribers, "nobody subscribes")
    for amplitude in (0.0, 0.25, 1.0, 0.0):
        device.set(amplitude, 80.0, 0)
        message = peer.next("/hand/set_feedback")
        assert (message.type, message.id, message.intensity) == (1, 0, amplitude)


def test_a_missing_subscriber_is_reported_until_one_subscribes(device, peer):
    with pytest.raises(DeviceError, match=r"nobody subscribes to ros2:hand/set_feedback \(ROS domain \d+\)"):
        device.set(0.0, 0.0, 0)
    peer.subscribe("/hand/set_feedback", JoyFeedback)
    until(lambda: device._publisher.has_subscribers, "nobody subscribes")
    device.set(0.5, 80.0, 1)
    assert peer.next("/hand/set_feedback").intensity == 0.5


def test_the_last_message_is_silence(device, peer):
    peer.subscribe("/hand/set_feedback", JoyFeedback)
    until(lambda: device._publisher.has_subscribers, "nobody subscribes")
    device.set(0.5, 80.0, 0)
    device.close()
    assert [peer.next("/hand/set_feedback").intensity for _ in range(2)] == [0.5, 0.0]


def test_setting_a_closed_device_is_an_error(device):
    device.close()
    with pytest.raises(DeviceError, match=r"cannot be published \(/hand/set_feedback is closed\)"):
        device.set(0.5, 80.0, 0)


def test_an_invalid_topic_is_refused(ros_network):
    with pytest.raises(BadInput, match="is no ROS topic"):
        Ros2Device("my hand")


def test_subscribers_are_found(ros_network, peer):
    peer.subscribe("/left/set_feedback", JoyFeedback)
    peer.subscribe("/left/text", String)
    found = Ros2Device.found()
    assert "subscribed to on ROS domain" in found["ros2:/left/set_feedback"]
    assert "ros2:/left/text" not in found


def test_the_first_command_reaches_an_existing_subscriber(ros_network, peer):
    peer.subscribe("/ready/set_feedback", JoyFeedback)
    device = Ros2Device("ready/set_feedback")
    device.set(0.5, 80.0, 0)
    assert peer.next("/ready/set_feedback").intensity == 0.5
    device.close()


def test_the_default_topic_is_that_of_the_joy_node(ros_network, peer, without_discovery):
    device = Ros2Device()
    until(lambda: "/joy/set_feedback" in peer.node.published(), "the topic is not published")
    device.close()
