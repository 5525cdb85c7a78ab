"""The force device of a run: its process, beside the vibration, and as the hand that steers.

`FORCE_DEVICES` lists the classes; `haptics/force/interface.py` is their contract.
"""

from contextlib import ExitStack
from typing import Any, NamedTuple

from haptigraph.clock import Clock, MonotonicClock
from haptigraph.config import Config
from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.haptics.force.hand import ForceHand
from haptigraph.haptics.force.output import ForceOutput, Vibration
from haptigraph.haptics.force.process import ForceProcess
from haptigraph.importing import chosen
from haptigraph.run_robot import SteeredRobot
from haptigraph.stages import ForceReadings, RobotReadings, Source
from haptigraph.teleop.leaders.steering import Steering

__all__ = ["FORCE_DEVICES", "Force", "device_class", "force_devices_found", "open_force", "with_force"]

FORCE_DEVICES = {
    "crtk": "haptigraph.haptics.force.devices.crtk:CrtkForce",
    "forcedimension": "haptigraph.haptics.force.devices.forcedimension:ForceDimension",
    "inverse3": "haptigraph.haptics.force.devices.inverse3:Inverse3",
    "simulated": "haptigraph.haptics.force.simulated:SimulatedForce",
}


class Force(NamedTuple):
    """The haptic output of a run with a force device."""

    output: ForceOutput
    readings: ForceReadings
    leaders: tuple[Steering, ...]


def device_class(kind: str) -> Any:
    """Return the class of a force device by its name; its capabilities are known without opening it.

    Raises:
        BadInput: If there is no such device.
    """
    return chosen(FORCE_DEVICES, "force device", kind)


def force_devices_found() -> dict[str, str]:
    """Return the force devices that can be opened now, and what each is; or why a kind cannot be used."""
    found = {"simulated": device_class("simulated").capabilities.limitations}
    for kind in sorted(FORCE_DEVICES.keys() - found.keys()):
        try:
            found |= device_class(kind).found() or {f"{kind}:...": "none found"}
        except HaptigraphError as error:
            found[f"{kind}:..."] = str(error)
    return found


def open_force(name: str, deadman_ms: float, hand: ForceHand | None = None) -> ForceProcess:
    """Open a force device by NAME or NAME:ARGUMENT in a process of its own; it exerts no force yet.

    Args:
        name: The device.
        deadman_ms: Without fixtures for this time, the hand is let go.
        hand: Receives its samples.

    Raises:
        BadInput: If there is no such device, or it cannot be opened.
    """
    kind, _, argument = name.partition(":")
    device_class(kind)
    listener = hand.add if hand else lambda sample: None
    return ForceProcess(name, FORCE_DEVICES[kind], argument, deadman_ms, listener)


def with_force(
    config: Config, vibration: Vibration, source: Source, robot: RobotReadings | None, clock: Clock
) -> Force:
    """Open the configured force device beside the other output of a run.

    Args:
        config: The configuration.
        vibration: The other output.
        source: What the hand steers, if it can be steered.
        robot: The robot, which the hand steers if a page may; None: there is none.
        clock: The run's.

    Raises:
        BadInput: If the device cannot be opened, or something else steers.
    """
    with ExitStack() as undo:
        undo.callback(vibration.close)
        force = _opened(config, vibration, source, robot, clock)
        undo.pop_all()
    return force


def _opened(
    config: Config, vibration: Vibration, source: Source, robot: RobotReadings | None, clock: Clock
) -> Force:
    name = config.haptics.force
    if config.run.leader:
        raise BadInput(f"--force {name} is the hand that steers; leave out --leader {config.run.leader}")
    if not isinstance(clock, MonotonicClock):
        raise BadInput(f"--force {name} works in real time; --fast is for files and the phantom")
    steerable: Any = robot.process if isinstance(robot, SteeredRobot) else source.teleop
    hand = ForceHand(clock) if steerable else None
    process = open_force(name, config.haptics.deadman_ms, hand)
    output = ForceOutput(
        process,
        vibration,
        lambda: steerable.settings.motion_scale if steerable else 1.0,
        hand=hand,
        is_off=config.haptics.max_amplitude == 0,
    )
    leaders = (Steering(name, hand, steerable.put).start(),) if hand else ()
    return Force(output, process, leaders)
