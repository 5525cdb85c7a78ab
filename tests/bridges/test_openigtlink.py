import socket
import struct

import numpy as np
import pytest
from helpers import make_step
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from ros_network import running, until

from haptigraph.bridges import openigtlink
from haptigraph.bridges.igtl_messages import HEADER, crc64, string, transform
from haptigraph.bridges.openigtlink import OpenIgtLink
from haptigraph.geometry import Point, Segment
from haptigraph.messages import Capture

LINE = Segment((2.0, 10.0), (1.0, -4.0))


def step_with(line, stamp_ns=0, **found):
    step = make_step(stamp_ns=stamp_ns)
    found = {"needle_line": line, "needle_tip": Point(line.end_mm)} | found if line else found
    return replace(step, observation=replace(step.observation, found=found))


def messages(data):
    """Parse messages by the specification, independently of the encoder."""
    while data:
        version, kind, device, stamp, size, crc = struct.unpack(">H12s20sQQQ", data[:58])
        body, data = data[58 : 58 + size], data[58 + size :]
        assert (version, len(body), crc64(body)) == (1, size, crc)
        yield kind.rstrip(b"\0").decode(), device.rstrip(b"\0").decode(), stamp * 10**9 >> 32, body


def test_the_checksum_has_the_standards_check_value():
    assert crc64(b"123456789") == 0x6C40DF5F0B497347  # CRC-64/ECMA-182's check value
    assert crc64(b"") == 0


@given(text=st.text(max_size=300), utc_ns=st.integers(0, 2**32 * 10**9 - 1))
def test_a_string_follows_the_specification(text, utc_ns):
    ((kind, device, stamp_ns, body),) = messages(string("State", utc_ns, text))
    encoding, length = struct.unpack(">HH", body[:4])
    assert (kind, device, encoding, body[4:].decode(), length) == (
        "STRING",
        "State",
        106,
        text,
        len(body) - 4,
    )
    assert stamp_ns in (utc_ns - 1, utc_ns)  # in units of 2**-32 s, rounded down


def test_a_transform_is_column_major():
    matrix = ((1.0, 2.0, 3.0, 4.0), (5.0, 6.0, 7.0, 8.0), (9.0, 10.0, 11.0, 12.0))
    ((kind, _, _, body),) = messages(transform("NeedleToEye", 0, matrix))
    assert kind == "TRANSFORM"
    assert struct.unpack(">12f", body) == (1, 5, 9, 2, 6, 10, 3, 7, 11, 4, 8, 12)


@pytest.fixture
def link(run):
    link = OpenIgtLink("0", run)
    yield link
    link.close()
    link.close()


def client_of(link):
    client = socket.create_connection(("127.0.0.1", link.port))
    client.settimeout(30)
    return client


def read(client, count):
    """Read this many whole messages."""
    read = []
    for _ in range(count):
        head = client.recv(HEADER.size, socket.MSG_WAITALL)
        size = HEADER.unpack(head)[4]
        read += messages(head + client.recv(size, socket.MSG_WAITALL))
    return read


def test_state_and_needle_are_sent_and_no_transform_without_a_needle(link):
    with client_of(link) as client:
        until(lambda: link.send_step(Capture(0, 0, None), step_with(LINE, 5)) or link._clients, "no client")
        received = read(client, 2)
        assert [(kind, device) for kind, device, _, _ in received] == [
            ("STRING", "SurgicalState"),
            ("TRANSFORM", "NeedleToEye"),
        ]
        assert struct.unpack(">12f", received[1][3])[9:] == (1.0, -4.0, 0.0)
        assert received[1][2] - 10**18 in (4, 5)
        link.send_step(Capture(0, 0, None), step_with(None))
        link.send_step(Capture(0, 0, None), step_with(None))
        assert [kind for kind, _, _, _ in read(client, 2)] == ["STRING", "STRING"]


def test_the_needle_is_sent_at_a_tip_beside_its_shaft(link):
    step = step_with(LINE, needle_tip=Point((1.3, -4.0)))
    with client_of(link) as client:
        until(lambda: link.send_step(Capture(0, 0, None), step) or link._clients, "no client")
        assert struct.unpack(">12f", read(client, 2)[1][3])[9:] == pytest.approx((1.3, -4.0, 0.0))


def test_a_needle_without_a_visible_tip_has_no_pose(link):
    whole = step_with(LINE)
    shaft = replace(whole, observation=replace(whole.observation, found={"needle_line": LINE}))
    with client_of(link) as client:
        until(lambda: link.send_step(Capture(0, 0, None), shaft) or link._clients, "no client")
        link.send_step(Capture(0, 0, None), whole)
        assert [kind for kind, _, _, _ in read(client, 3)] == ["STRING", "STRING", "TRANSFORM"]


def test_data_from_clients_is_ignored(link):
    with client_of(link) as client:
        client.sendall(b"\xff" * 58 + struct.pack(">Q", 2**63) + b"GET_TRANS" * 1000)
        for _ in range(3):
            link.send_step(Capture(0, 0, None), step_with(LINE))
        until(lambda: link.send_step(Capture(0, 0, None), step_with(LINE)) or link._clients, "no client")
        assert [kind for kind, _, _, _ in read(client, 4)] == ["STRING", "TRANSFORM"] * 2


def test_a_stalled_client_is_disconnected_and_the_others_get_whole_messages(link, monkeypatch):
    with client_of(link), client_of(link) as healthy:  # the first reads nothing
        link.send_step(Capture(0, 0, None), step_with(LINE))
        assert len(link._clients) == 2
        link._clients[0]._connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        long = replace(step_with(LINE).conclusion, state="s" * 5000)
        for _ in range(300):
            link.send_step(Capture(0, 0, None), replace(step_with(LINE), conclusion=long))
            read(healthy, 2)
        assert len(link._clients) == 2  # it misses steps, and blocks nothing
        assert link.take_problems() == ()
        monkeypatch.setattr(openigtlink, "STALL_TIMEOUT_S", 0.0)
        until(
            lambda: link.send_step(Capture(0, 0, None), step_with(LINE)) or len(link._clients) == 1,
            "still connected",
        )
        assert link.take_problems() == ("a client stalled for 0 s and was disconnected",)


def test_a_client_that_disconnects_is_no_problem(link):
    with client_of(link):
        until(lambda: link.send_step(Capture(0, 0, None), step_with(LINE)) or link._clients, "no client")
    until(
        lambda: link.send_step(Capture(0, 0, None), step_with(LINE)) or not link._clients, "still connected"
    )
    assert link.take_problems() == ()


def is_served(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def test_a_pyigtl_client_receives_a_run_live(free_port, quick_uri, procedure):
    pyigtl = pytest.importorskip("pyigtl", reason="pyigtl needs a C compiler; pip install pyigtl")
    with running(quick_uri, "--bridge", f"openigtlink:{free_port}") as process:
        until(lambda: is_served(free_port), "no server")
        with socket.create_connection(("127.0.0.1", free_port)) as invalid:
            invalid.sendall(b"\xff" * 58 + b"GET_TRANSFORM" * 1000)
        client, states, tips = pyigtl.OpenIGTLinkClient(port=free_port), [], []
        while len(states) < 3 or len(tips) <= 10:
            message = client.wait_for_message("SurgicalState", timeout=30)
            assert message is not None, process.output
            if message.string not in states:
                states.append(message.string)
            needle = client.wait_for_message("NeedleToEye", timeout=0)
            if needle is not None:
                tips.append(needle.matrix[:3, 3])
                assert np.allclose(np.linalg.det(needle.matrix[:3, :3]), 1.0, atol=1e-5)
        client.stop()
    assert set(states) <= {state.name for state in procedure.states}
    assert all(np.linalg.norm(tip) < 20 for tip in tips)
    assert "! bridge" not in process.output
    assert "Traceback" not in process.output
