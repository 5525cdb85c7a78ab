"""Play one vibration outside a trial, through the same guard, device and pages as a trial's haptic output."""

from collections.abc import Callable

from msgspec import Struct

from haptigraph.analysis.actuators import play_pattern
from haptigraph.assemble import open_device
from haptigraph.clock import Clock
from haptigraph.config import HapticsConfig
from haptigraph.errors import BadInput, DeviceError, NotSilent
from haptigraph.haptics.guard import Guard
from haptigraph.haptics.observed_device import Listener, ObservedDevice
from haptigraph.haptics.pattern import duration_ns
from haptigraph.haptics.profiles.profile import open_profile
from haptigraph.messages import OFF, Pattern

__all__ = ["Stimulus", "play_stimulus"]

BEFORE_NS = 500_000_000  # so that the movement that pressed the button is over
LASTING_NS = 1_000_000_000  # of a pattern that would continue
AFTER_NS = 200_000_000


class Stimulus(Struct, frozen=True):
    """One vibration that a page requests."""

    name: str
    """What it is for; once it was played, `StudyService.played`."""
    pattern: Pattern
    """One that would continue ends after a second."""
    needs_levels: bool = False
    """Whether a device that only knows on and off is refused."""


def play_stimulus(
    stimulus: Stimulus,
    config: HapticsConfig,
    clock: Clock,
    listener: Listener,
    sent: Callable[[int], None],
) -> None:
    """Play a stimulus, and return when it is over; the device is silent and closed on every exit.

    Args:
        stimulus: What to play.
        config: Device and limits, as of a trial.
        clock: Paces it.
        listener: Receives every level, for the pages.
        sent: Called with the time of every command, which keeps the level on the pages alive.

    Raises:
        BadInput: If the device does not open, its profile cannot be used, or it lacks levels that are needed.
        DeviceError: If the device failed meanwhile.
        NotSilent: If it may still vibrate.
    """
    profile, _ = open_profile(config)
    device = open_device(config.device)
    guard = Guard(ObservedDevice(device, listener), config, profile)
    try:
        if stimulus.needs_levels and device.capabilities.amplitude_levels < 2:
            raise BadInput(f"{config.device} only knows on and off; choose a device with several amplitudes")
        length_ns = duration_ns(stimulus.pattern) or LASTING_NS
        for part, part_ns in ((OFF, BEFORE_NS), (stimulus.pattern, length_ns), (OFF, AFTER_NS)):
            play_pattern(guard, part, part_ns, clock, sent)
    finally:
        guard.close()
    if not guard.is_silent:
        raise NotSilent(config.device)
    if faults := guard.take_faults():
        raise DeviceError(f"{config.device}: {faults[0].message}")
