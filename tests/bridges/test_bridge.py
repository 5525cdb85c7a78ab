import threading
from functools import partial

import pytest
from helpers import LOW, every_moment, make_step
from ros_network import until

from haptigraph.bridges import bridge as bridge_module
from haptigraph.bridges.bridge import MAX_QUEUED, Bridge
from haptigraph.bridges.opening import BRIDGES, open_bridges
from haptigraph.errors import BadInput
from haptigraph.messages import Capture
from haptigraph.stages import Sink


class Link:
    """A link that can be blocked or broken."""

    def __init__(self):
        self.steps, self.outputs, self.problems = [], [], []
        self.gate, self.error, self.closed = threading.Event(), None, threading.Event()
        self.gate.set()

    def send_step(self, capture, step):
        self.gate.wait(30)
        if self.error is not None:
            raise self.error
        self.steps.append(step.stamp_ns)

    def send_output(self, stamp_ns, amplitude, frequency_hz):
        self.outputs.append((stamp_ns, amplitude, frequency_hz))

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


def test_every_step_and_every_output_is_sent_in_order(link):
    bridge = Bridge("any", link)
    assert isinstance(bridge, Sink)
    write(bridge, range(10))
    bridge.send_output(3, 0.5, 80.0)
    bridge.close()
    bridge.close()
    assert (link.steps, link.outputs, bridge.dropped) == (list(range(10)), [(3, 0.5, 80.0)], 0)
    assert link.closed.is_set()


def test_a_hanging_network_never_delays_the_loop_and_gets_the_newest_steps(link):
    link.gate.clear()
    bridge = Bridge("any", link)
    write(bridge, range(1000))  # returns though nothing is sent
    link.gate.set()
    bridge.close()
    assert link.steps[-MAX_QUEUED:] == list(range(1000 - MAX_QUEUED, 1000))
    assert len(link.steps) + bridge.dropped == 1000


def test_a_failing_network_is_reported_once_and_retried(link):
    bridge, link.error = Bridge("any", link), OSError("cable out")
    for stamp_ns in range(5):
        write(bridge, [stamp_ns])
    until(lambda: bridge.dropped == 5, "not all were tried")
    link.error = None
    write(bridge, [5])
    bridge.close()
    assert [fault.message for fault in bridge.take_faults()] == ["any: cable out"]
    assert (link.steps, bridge.dropped) == ([5], 5)


def test_the_number_of_different_problems_is_limited(link):
    bridge = Bridge("any", link)
    link.problems = [f"nonsense {number}" for number in range(1000)]
    faults = bridge.take_faults()
    assert [fault.where for fault in faults] == ["bridge"] * len(faults)
    assert len(faults) == bridge_module.MAX_PROBLEMS
    bridge.close()


def test_a_network_that_never_responds_is_abandoned(link, monkeypatch):
    monkeypatch.setattr(bridge_module, "CLOSE_TIMEOUT_S", 0.01)
    link.gate.clear()
    bridge = Bridge("any", link)
    write(bridge, [1])
    bridge.close()
    assert [fault.message for fault in bridge.take_faults()] == ["any: does not respond; it was abandoned"]


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("ros", "unknown bridge 'ros'; did you mean 'ros2'? valid: foxglove, lsl, openigtlink, ros2"),
        ("lsl:x", "bridge lsl takes no argument, found 'x'; remove it"),
        ("openigtlink:x", "bridge openigtlink:x: expected openigtlink:PORT or openigtlink:HOST:PORT"),
        ("foxglove:1:70000", "bridge foxglove:1:70000: expected foxglove:PORT"),
        ("openigtlink:no.such.host.invalid:1", "bridge openigtlink cannot listen at no.such.host.invalid:1"),
        ("ros2:a-b", "'a-b' is no ROS topic"),
    ],
)
def test_a_bridge_that_cannot_be_opened_is_reported_and_all_are_closed(
    run, free_port, ros_network, name, problem
):
    for _ in range(2):  # the port is free again
        with pytest.raises(BadInput) as raised:
            open_bridges([f"openigtlink:{free_port}", name], run)
        assert problem in str(raised.value)


@pytest.mark.parametrize("name", BRIDGES)
def test_every_bridge_sends_any_step_and_closes_twice(run, free_port, ros_network, lsl_network, name):
    argument = {"foxglove": f":{free_port}", "openigtlink": f":{free_port}"}.get(name, "")
    (bridge,) = open_bridges([name + argument], run)
    write(bridge, range(3))
    bridge.send_output(1, 0.3, 80.0)
    bridge.close()
    bridge.close()
    assert bridge.take_faults() == ()
    assert bridge.dropped == 0


def test_a_port_in_use_is_reported(run, free_port):
    (first,) = open_bridges([f"openigtlink:{free_port}"], run)
    for name in ("openigtlink", "foxglove"):
        pytest.importorskip("foxglove")
        with pytest.raises(BadInput, match=f"bridge {name} cannot listen at 127.0.0.1:{free_port} "):
            open_bridges([f"{name}:{free_port}"], run)
    first.close()


@pytest.mark.parametrize("call", [write, lambda bridge, _: bridge.take_faults()], ids=("write", "faults"))
def test_ctrl_c_at_any_moment_blocks_neither_output_nor_closing(call):
    for moment, pressing_ctrl_c in enumerate(every_moment()):
        link = Link()
        bridge = Bridge("any", link)
        write(bridge, range(MAX_QUEUED))
        pressing_ctrl_c(partial(call, bridge, [99]))
        output = threading.Thread(target=bridge.send_output, args=(3, 0.5, 80.0), daemon=True)
        output.start()
        output.join(10)
        assert not output.is_alive(), f"at moment {moment}"
        bridge.close()
        assert link.closed.is_set(), f"at moment {moment}"
