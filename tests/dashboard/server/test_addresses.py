"""The addresses to open, and their QR codes."""

import socket

import cv2
import ifaddr
import numpy as np
import pytest

from haptigraph.dashboard.server import addresses as module
from haptigraph.dashboard.server.addresses import addresses, qr_code


class Adapter:
    def __init__(self, *ips):
        self.ips = [ifaddr.IP(ip, 24, "eth0") for ip in ips]


@pytest.fixture
def listener():
    with socket.socket() as opened:
        opened.bind(("127.0.0.1", 0))
        yield opened


def hosts(monkeypatch, listener, host, *adapters):
    monkeypatch.setattr(module.ifaddr, "get_adapters", lambda: adapters)
    port = listener.getsockname()[1]
    found = addresses(listener, host, "a b", "/x")
    assert all(each.endswith(f":{port}/x?token=a%20b") for each in found)
    return [each.removeprefix("http://").partition(f":{port}/")[0] for each in found]


ETHERNET, LOOP = (
    Adapter("192.0.2.7", ("2001:db8::7", 0, 0), ("fe80::1", 0, 2)),
    Adapter("127.0.0.1", ("::1", 0, 0)),
)


def test_one_address_is_the_one_that_was_asked_for(monkeypatch, listener):
    assert hosts(monkeypatch, listener, "127.0.0.1", LOOP, ETHERNET) == ["127.0.0.1"]
    assert hosts(monkeypatch, listener, "::1", LOOP, ETHERNET) == ["[::1]"]


def test_all_addresses_are_those_of_the_machine_that_others_can_open(monkeypatch, listener):
    assert hosts(monkeypatch, listener, "0.0.0.0", LOOP, ETHERNET, Adapter("169.254.3.4", "10.0.0.3")) == [
        "192.0.2.7",
        "10.0.0.3",
    ]
    assert hosts(monkeypatch, listener, "::", LOOP, ETHERNET) == ["192.0.2.7", "[2001:db8::7]"]


def test_without_a_network_it_is_this_machine(monkeypatch, listener):
    assert hosts(monkeypatch, listener, "0.0.0.0", LOOP) == ["127.0.0.1"]


def test_the_qr_code_can_be_read():
    address = "http://192.0.2.7:40123/?token=AbC-123"
    half = {" ": (0, 0), "▀": (1, 0), "▄": (0, 1), "█": (1, 1)}
    rows = qr_code(address).splitlines()
    width = max(map(len, rows))
    modules = np.array(
        [[half[character][part] for character in row.ljust(width)] for row in rows for part in (0, 1)],
        np.uint8,
    )
    picture = np.kron(modules * 255, np.ones((8, 8), np.uint8))
    texts = [cv2.QRCodeDetector().detectAndDecode(each)[0] for each in (picture, 255 - picture)]
    assert address in texts
