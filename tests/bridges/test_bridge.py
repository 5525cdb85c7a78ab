import threading
from functools import partial

import pytest
from helpers import LOW, every_moment, make_step
from ros_network import until

from haptigraph.bridges import bridge as bridge_module
from haptigraph.bridges.bridge import MOST_ITEMS, Bridge
from haptigraph.bridges.opening import BRIDGES, open_bridges
from haptigraph.errors import BadInput
from haptigraph.messages import Capture
from haptigraph.stages import Sink


class Link:
    """A link that can be held up or broken."""

    def __init__(self):
        self.sent, self.felts, self.problems = [], [], []
        self.gate, self.error, self.closed = threading.Event(), None, threading.Event()
        self.gate.set()

    def send(self, capture, step):
        self.gate.wait(30)
        if self.error is not None:
            raise self.error
        self.sent.append(step.stamp_ns)

    def felt(self, stamp_ns, amplitude, frequency_hz):
        self.felts.append((stamp_ns, amplitude, frequency_hz))

    def take_problems(self):
        problems, self.problems = tuple(self.problems), []
        return problems

    def close(self):
        self.closed.set()


@pytest.fixture
def link():
    link = Link()
    yield link
    link.gate.set()


def write(bridge, stamps):
    for stamp_ns in stamps:
        bridge.write(Capture(0, stamp_ns, None), make_step(LOW, stamp_ns=stamp_ns))


def test_every_step_and_every_touch_arrives_in_order(link):
    bridge = Bridge("any", link)
    assert isinstance(bridge, Sink)
    write(bridge, range(10))
    bridge.felt(3, 0.5, 80.0)
    bridge.close()
    bridge.close()
    assert (link.sent, link.felts, bridge.dropped) == (list(range(10)), [(3, 0.5, 80.0)], 0)
    assert link.closed.is_set()


def test_a_network_that_hangs_never_holds_up_the_loop_and_gets_the_newest(link):
    link.gate.clear()
    bridge = Bridge("any", link)
    write(bridge, range(1000))  # returns though nothing is sent
    link.gate.set()
    bridge.close()
    assert link.sent[-MOST_ITEMS:] == list(range(1000 - MOST_ITEMS, 1000))
    assert len(link.sent) + bridge.dropped == 1000


def test_a_network_that_fails_is_told_once_and_tried_again(link):
    bridge, link.error = Bridge("any", link), OSError("cable out")
    for stamp_ns in range(5):
        write(bridge, [stamp_ns])
    until(lambda: bridge.dropped == 5, "not all were tried")
    link.error = None
    write(bridge, [5])
    bridge.close()
    assert [fault.message for fault in bridge.take_faults()] == ["any: cable out"]
    assert (link.sent, bridge.dropped) == ([5], 5)


def test_problems_that_all_differ_are_not_told_without_end(link):
    bridge = Bridge("any", link)
    link.problems = [f"nonsense {number}" for number in range(1000)]
    told = bridge.take_faults()
    assert [fault.where for fault in told] == ["bridge"] * len(told)
    assert len(told) == bridge_module.MOST_TOLD
    bridge.close()


def test_a_network_that_never_answers_is_left_behind(link, monkeypatch):
    monkeypatch.setattr(bridge_module, "CLOSE_TIMEOUT_S", 0.01)
    link.gate.clear()
    bridge = Bridge("any", link)
    write(bridge, [1])
    bridge.close()
    assert [fault.message for fault in bridge.take_faults()] == ["any: does not answer; it was left behind"]


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("ros", "unknown bridge 'ros'; did you mean 'ros2'? valid: foxglove, lsl, openigtlink, ros2"),
        ("lsl:x", "bridge lsl takes nothing behind a colon, found 'x'"),
        ("openigtlink:x", "bridge openigtlink:x: expected openigtlink:PORT or openigtlink:HOST:PORT"),
        ("foxglove:1:70000", "bridge foxglove:1:70000: expected foxglove:PORT"),
        ("openigtlink:no.such.host.invalid:1", "bridge openigtlink cannot listen at no.such.host.invalid:1"),
        ("ros2:a-b", "'a-b' is no ROS topic"),
    ],
)
def test_what_cannot_be_opened_is_one_sentence_and_leaves_nothing_open(
    run, free_port, ros_network, name, told
):
    for _ in range(2):  # the port is free again
        with pytest.raises(BadInput) as refused:
            open_bridges([f"openigtlink:{free_port}", name], run)
        assert told in str(refused.value)


@pytest.mark.parametrize("name", BRIDGES)
def test_every_bridge_takes_any_step_and_closes_twice(run, free_port, ros_network, lsl_network, name):
    argument = {"foxglove": f":{free_port}", "openigtlink": f":{free_port}"}.get(name, "")
    (bridge,) = open_bridges([name + argument], run)
    write(bridge, range(3))
    bridge.felt(1, 0.3, 80.0)
    bridge.close()
    bridge.close()
    assert bridge.take_faults() == ()
    assert bridge.dropped == 0


def test_a_port_in_use_is_told(run, free_port):
    (first,) = open_bridges([f"openigtlink:{free_port}"], run)
    for name in ("openigtlink", "foxglove"):
        pytest.importorskip("foxglove")
        with pytest.raises(BadInput, match=f"bridge {name} cannot listen at 127.0.0.1:{free_port} "):
            open_bridges([f"{name}:{free_port}"], run)
    first.close()


@pytest.mark.parametrize("call", [write, lambda bridge, _: bridge.take_faults()], ids=("write", "faults"))
def test_ctrl_c_at_any_moment_holds_up_neither_touch_nor_the_end(call):
    for moment, pressing_ctrl_c in enumerate(every_moment()):
        link = Link()
        bridge = Bridge("any", link)
        write(bridge, range(MOST_ITEMS))
        pressing_ctrl_c(partial(call, bridge, [99]))
        touch = threading.Thread(target=bridge.felt, args=(3, 0.5, 80.0), daemon=True)
        touch.start()
        touch.join(10)
        assert not touch.is_alive(), f"at moment {moment}"
        bridge.close()
        assert link.closed.is_set(), f"at moment {moment}"
