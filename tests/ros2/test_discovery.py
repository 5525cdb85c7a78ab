"""Which processes find each other, by ROS's environment variables, on this machine alone."""

import json
import os
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from helpers import mostly_slow
from ros_network import tag, until

pytest.importorskip("cyclonedds")

from haptigraph.errors import BadInput
from haptigraph.ros2 import discovery
from haptigraph.ros2.discovery import discovery_settings

PROGRAM = Path(__file__).with_name("ros_discovering.py")
LOOPBACK = '<General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>{}</General>'
WITHOUT_MULTICAST = LOOPBACK.format("<AllowMulticast>false</AllowMulticast>")
VARIABLES = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS", "CYCLONEDDS_URI", "ROS_DOMAIN_ID")


class Participant:
    """Another process that publishes /NAME."""

    def __init__(self, name, settings, **variables):
        environment = {key: value for key, value in os.environ.items() if key not in VARIABLES}
        environment |= {
            "ROS_DOMAIN_ID": str(101 + os.getpid() % 100),  # not those of other tests
            "CYCLONEDDS_URI": f"<CycloneDDS><Domain>{settings}</Domain></CycloneDDS>",
        }
        self.process = subprocess.Popen(
            [sys.executable, str(PROGRAM), name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment | variables,
        )
        self.name = name

    def topics(self):
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return set(json.loads(self.process.stdout.readline()))

    def finds(self, other):
        return f"/{other.name}" in self.topics()


@contextmanager
def participants(*each):
    try:
        yield each
    finally:
        for participant in each:
            participant.process.kill()
            participant.process.communicate()


def in_range(name, which, settings=None, **variables):
    own_peers = '<Peers addlocalhost="false"/>'  # Cyclone DDS adds localhost where nothing else is left
    private = WITHOUT_MULTICAST + f"<Discovery><Tag>{in_range.tag}</Tag>{own_peers}</Discovery>"
    variables = {"ROS_AUTOMATIC_DISCOVERY_RANGE": which} | variables
    return Participant(name, private if settings is None else settings, **variables)


in_range.tag = tag()


def test_two_processes_find_each_other_on_localhost():
    with participants(in_range("first", "LOCALHOST"), in_range("second", "LOCALHOST")) as (first, second):
        until(lambda: first.finds(second) and second.finds(first), "they do not find each other")


def test_off_finds_nobody_while_others_find_each_other():
    lonely = in_range("lonely", "OFF", LOOPBACK.format(""))  # a tag of the user's would prevail over OFF
    others = [in_range(name, "LOCALHOST", LOOPBACK.format("")) for name in ("first", "second")]
    with participants(lonely, *others):
        assert lonely.topics() == {"/lonely"}
        until(lambda: others[0].finds(others[1]) and others[1].finds(others[0]), "nothing to compare with")
        end_s = time.monotonic() + 2.0  # longer than the others needed
        while time.monotonic() < end_s:
            assert lonely.topics() == {"/lonely"}
            assert not any(other.finds(lonely) for other in others)


@pytest.mark.parametrize("is_late", mostly_slow([False, True], True))
def test_a_static_peer_is_found_and_finds_back(is_late):
    asking = in_range("asking", "SUBNET", ROS_STATIC_PEERS="127.0.0.1; ")
    if is_late:
        assert asking.topics() == {"/asking"}  # it has asked, and nobody was there
    asked = in_range("asked", "SUBNET")
    with participants(asked, asking):
        until(lambda: asking.finds(asked) and asked.finds(asking), "the peer is not found")


@pytest.mark.slow
def test_without_multicast_and_static_peer_nobody_is_found():
    with participants(in_range("first", ""), in_range("second", "SUBNET")) as (first, second):
        end_s = time.monotonic() + 2.0
        while time.monotonic() < end_s:
            assert (first.topics(), second.topics()) == ({"/first"}, {"/second"})


def settings_of(monkeypatch, which, peers=""):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", which)
    monkeypatch.setenv("ROS_STATIC_PEERS", peers)
    return discovery_settings()


def test_the_ranges_are_those_of_rmw_cyclonedds(monkeypatch):
    without, with_multicast = "<AllowMulticast>false</AllowMulticast>", "AllowMulticast"
    local, subnet = settings_of(monkeypatch, "LOCALHOST"), settings_of(monkeypatch, "SUBNET")
    assert without in local and '<Peer address="localhost" ' in local
    assert with_multicast not in subnet and "Peer" not in subnet
    assert settings_of(monkeypatch, "") == settings_of(monkeypatch, " SUBNET ") == subnet
    off = settings_of(monkeypatch, "OFF", "no.such.host.invalid")  # ROS ignores the peers, too
    assert without in off and f"discovery_off_{os.getpid()}</Tag>" in off and "Peer" not in off
    assert settings_of(monkeypatch, "SYSTEM_DEFAULT", "127.0.0.1") == ""


def test_static_peers_are_a_list_with_semicolons(monkeypatch):
    settings = settings_of(monkeypatch, "LOCALHOST", "127.0.0.1;; localhost:7412 ;")
    addresses = [part.partition('"')[0] for part in settings.split('address="')[1:]]
    assert addresses == ["localhost", "127.0.0.1", "localhost:7412"]


@pytest.mark.parametrize("which", ["subnet", "0", "LAN"])
def test_an_unknown_range_is_refused(monkeypatch, which):
    with pytest.raises(BadInput, match=f"found '{which}'; expected one of SUBNET, LOCALHOST, OFF, SYSTEM_DE"):
        settings_of(monkeypatch, which)


@pytest.mark.parametrize("peer", ["no.such.host.invalid", "127.0.0.1:x", "127.0.0.1:0", 'a"/><x', "fe80::1"])
def test_an_unusable_peer_is_refused(monkeypatch, peer):
    def resolve(host, *_):  # no name server is asked
        if host not in ("127.0.0.1", "localhost"):
            raise OSError

    monkeypatch.setattr(discovery.socket, "getaddrinfo", resolve)
    with pytest.raises(
        BadInput, match="is not an IPv4 address or a host name that can be resolved"
    ) as caught:
        settings_of(monkeypatch, "SUBNET", f"127.0.0.1;{peer}")
    assert str(caught.value).startswith(f"ROS_STATIC_PEERS: {peer!r}")


def test_an_invalid_variable_ends_a_program_with_a_sentence():
    participant = in_range("first", "EVERYWHERE")
    with participants(participant):
        assert participant.process.wait(30) == 1
