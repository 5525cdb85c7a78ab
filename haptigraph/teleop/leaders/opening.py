"""Open leaders by name: gamepad:0, keys, joy, crtk:MTML."""

from typing import Any

from haptigraph.clock import Clock
from haptigraph.config import Config
from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.importing import chosen
from haptigraph.teleop.leaders.leader import Leader
from haptigraph.teleop.leaders.steering import Steering

__all__ = ["LEADERS", "leaders_found", "open_leader", "steered"]

LEADERS = {
    "crtk": "haptigraph.teleop.leaders.crtk:CrtkLeader",
    "gamepad": "haptigraph.teleop.leaders.gamepad:GamepadLeader",
    "joy": "haptigraph.teleop.leaders.joy:JoyLeader",
    "keys": "haptigraph.teleop.leaders.keys:KeysLeader",
}


def open_leader(uri: str, clock: Clock) -> Leader:
    """Open a leader by NAME or NAME:ARGUMENT.

    Args:
        uri: The leader.
        clock: Measures how long a stick is held, and since when a leader is silent.

    Raises:
        BadInput: If there is no such leader, or it cannot be opened.
        MissingExtra: If its library is not installed.
    """
    kind, _, argument = uri.partition(":")
    leader: Leader = _class(kind)(argument, clock)
    return leader


def steered(config: Config, steerable: Any, clock: Clock) -> list[Steering]:
    """Let the configured leader, if any, steer in a thread of its own until it is closed.

    Args:
        config: Names the leader.
        steerable: Its `put` receives the motions; None if the source cannot be steered.
        clock: The run's.

    Raises:
        BadInput: If nothing can be steered, or the leader cannot be opened.
    """
    name = config.run.leader
    if not name:
        return []
    if config.robot.steer:
        raise BadInput(
            f"--leader {name} does not go with --steer; use haptigraph robot steer ROBOT --leader {name}"
        )
    if steerable is None:
        raise BadInput(f"--leader {name} steers teleop; {config.source.uri} cannot be steered")
    return [Steering(name, open_leader(name, clock), steerable.put).start()]


def leaders_found() -> dict[str, str]:
    """Return the leaders that can be opened now, and what each is; or why a kind cannot be used."""
    found: dict[str, str] = {}
    for kind in sorted(LEADERS):
        try:
            found |= _class(kind).found()
        except HaptigraphError as error:
            found[f"{kind}:..."] = str(error)
    return found


def _class(kind: str) -> Any:
    return chosen(LEADERS, "leader", kind)
