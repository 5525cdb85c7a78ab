"""Which ROS 2 nodes find each other: ROS's environment variables -> configuration of Cyclone DDS.

ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_STATIC_PEERS have the meaning that they have with rmw_cyclonedds
(https://docs.ros.org/en/jazzy/Tutorials/Advanced/Improved-Dynamic-Discovery.html).
"""

import os
import socket

from haptigraph.errors import BadInput

__all__ = ["discovery_settings"]

RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
# Nodes that are found without multicast have a number each, which selects their port. DDS has 120 of them; a
# peer without port is asked at every number, so that ROS limits them.
MAX_INDEX, MAX_ASKED_INDEX = 119, 32
# By default, Cyclone DDS 11 asks every 30 s, and gives up a peer that has not answered in 30 s; it would
# never find a robot that is switched on later.
ASK_INTERVAL_S = 5


def discovery_settings() -> str:
    """Return a fragment of Cyclone DDS's configuration; empty: its defaults.

    Raises:
        BadInput: If a variable is not valid, or a peer's name cannot be resolved.
    """
    text = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").strip() or "SUBNET"
    if text not in RANGES:
        raise BadInput(
            f"found {text!r}; expected one of {', '.join(RANGES)}", "ROS_AUTOMATIC_DISCOVERY_RANGE"
        )
    if text == "SYSTEM_DEFAULT":
        return ""
    if text == "OFF":  # only a participant with the same tag would be discovered
        tag = f"<Tag>haptigraph_discovery_off_{os.getpid()}</Tag>"
        return _fragment(f"{tag}<ParticipantIndex>none</ParticipantIndex>", multicast=False)
    peers = [*(["localhost"] if text == "LOCALHOST" else []), *_static_peers()]
    limit = MAX_ASKED_INDEX if peers else MAX_INDEX
    discovery = (
        f"<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>{limit}</MaxAutoParticipantIndex>"
    )
    if peers:
        listed = "".join(f'<Peer address="{peer}" pruneDelay="inf"/>' for peer in peers)
        discovery += f"<Peers>{listed}</Peers><SPDPInterval>{ASK_INTERVAL_S}s</SPDPInterval>"
    return _fragment(discovery, multicast=text == "SUBNET")


def _fragment(discovery: str, *, multicast: bool) -> str:
    general = "" if multicast else "<General><AllowMulticast>false</AllowMulticast></General>"
    return f"<CycloneDDS><Domain>{general}<Discovery>{discovery}</Discovery></Domain></CycloneDDS>"


def _static_peers() -> list[str]:
    """Return the peers of ROS_STATIC_PEERS, checked: Cyclone DDS aborts the process at an unknown one."""
    peers = [peer.strip() for peer in os.environ.get("ROS_STATIC_PEERS", "").split(";")]
    for peer in filter(None, peers):
        host, _, port = peer.partition(":")
        try:
            if port and not (port.isdecimal() and 0 < int(port) < 65536):
                raise ValueError
            socket.getaddrinfo(host, None, socket.AF_INET)
        except (OSError, ValueError):
            raise BadInput(
                f"{peer!r} is not an IPv4 address or a host name that can be resolved; expected for example "
                "192.168.0.7;robot.local",
                "ROS_STATIC_PEERS",
            ) from None
    return [peer for peer in peers if peer]
