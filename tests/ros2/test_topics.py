import pytest

pytest.importorskip("cyclonedds")

from haptigraph.ros2 import topics
from haptigraph.ros2.node import Node
from haptigraph.ros2.topics import one_search, topics_found
from haptigraph.ros2.types import String


def test_a_topic_of_another_node_is_found(peer):
    peer.node.publisher("/one", String)
    assert topics_found(Node.published)["/one"].endswith("String_")


def test_lists_can_share_one_search(monkeypatch):
    made = []

    class Fake:
        def __init__(self):
            made.append(self)
            self.is_closed = False

        def close(self):
            self.is_closed = True

    monkeypatch.setattr(topics, "Node", Fake)
    monkeypatch.setattr(topics, "SEARCH_S", 0.0)
    with one_search():
        assert topics_found(lambda node: {"/a": str(node.is_closed)}) == {"/a": "False"}
        topics_found(lambda node: {})
        assert len(made) == 1 and not made[0].is_closed
    assert made[0].is_closed
    topics_found(lambda node: {})
    assert len(made) == 2 and made[1].is_closed
