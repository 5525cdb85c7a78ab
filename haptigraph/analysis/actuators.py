"""List the available haptic devices, and test one by playing the haptic grammar.

Device classes that can detect their hardware have a static method `found()`.
"""

import time
from collections.abc import Callable, Sequence

from rich.table import Table

from haptigraph.clock import Clock
from haptigraph.config import HapticsConfig
from haptigraph.errors import HaptigraphError, MissingExtra
from haptigraph.graph import SceneGraph
from haptigraph.haptics.guard import Guard
from haptigraph.haptics.observed_device import PAGE_CONTROLLER
from haptigraph.haptics.pattern import duration_ns, unsupported
from haptigraph.haptics.profiles.profile import DeviceProfile
from haptigraph.messages import (
    OFF,
    Capabilities,
    Conclusion,
    Fault,
    HapticCommand,
    Observation,
    Pattern,
    Step,
)
from haptigraph.run_device import DEVICES, device_class
from haptigraph.run_report import Durations
from haptigraph.stages import Device

__all__ = [
    "DeviceTest",
    "actuators",
    "advance_until",
    "guarded_step",
    "numbers_text",
    "play_grammar",
    "play_pattern",
]

ALWAYS = {"audio": "audio:FILE.wav", "console": "console", "trace": "trace:FILE.csv"}
CONTINUOUS_NS, PAUSE_NS, IMAGE_NS = 1_500_000_000, 500_000_000, 33_000_000


def actuators() -> tuple[Table, list[str]]:
    """Return a table of all devices (URI, availability, capabilities), and their limitations, a line each."""
    table = Table(title="Haptic devices", title_justify="left")
    for heading in ("device", "available", "levels", "frequency", "shortest pulse", "update rate"):
        table.add_column(heading, overflow="fold")
    limitations = []
    for kind in sorted(DEVICES):
        cls = device_class(kind)
        available = {ALWAYS[kind]: "always"} if kind in ALWAYS else {}
        try:
            available |= getattr(cls, "found", dict)()
        except MissingExtra as missing:
            available[f"{kind}:..."] = str(missing)
        except HaptigraphError as error:
            available[f"{kind}:..."] = f"cannot be used: {error}"
        available = available or {f"{kind}:...": "none found"}
        cells = _capability_cells(cls.capabilities)
        table.add_row("\n".join(available), "\n".join(available.values()), *cells)
        limitations.append(f"{kind:8} {cls.capabilities.limitations}")
    table.add_row("-", "a controller on the page: haptigraph live", *_capability_cells(PAGE_CONTROLLER))
    return table, limitations


class DeviceTest:
    """A device that measures its commands during a test.

    Args:
        device: The device; the duration of each command is measured, a round trip if the device confirms it.
    """

    def __init__(self, device: Device) -> None:
        self.capabilities = device.capabilities
        self.latencies = Durations()
        self.count = 0
        self.faults: list[Fault] = []
        self.is_silent = False
        """Whether the device was closed and raised no doubt that it is silent."""
        self._device = device

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Forward a command to the device and measure it."""
        started_ns = time.perf_counter_ns()
        self._device.set(amplitude, frequency_hz, stamp_ns)
        self.latencies.add(time.perf_counter_ns() - started_ns)
        self.count += 1

    def close(self) -> None:
        """Close the device."""
        self._device.close()

    def end(self, guard: Guard) -> None:
        """Close the guard that drives it, and note what failed and whether it is silent."""
        guard.close()
        self.faults = [fault for fault in guard.take_faults() if not fault.is_over]
        self.is_silent = guard.is_silent


def play_grammar(
    device: Device,
    patterns: Sequence[Pattern],
    clock: Clock,
    announce: Callable[[str], None],
    profile: DeviceProfile | None = None,
) -> DeviceTest:
    """Play every pattern through the guard; the device is silent and closed on every exit.

    Args:
        device: The device; closed afterwards.
        patterns: The haptic grammar of a procedure.
        clock: Paces the playback.
        announce: Called with one line of text per pattern.
        profile: How strong the device feels; None: amplitudes are its drive.
    """
    test = DeviceTest(device)
    guard = Guard(test, HapticsConfig(), profile)
    capabilities = profile.applied_to(device.capabilities) if profile else device.capabilities
    try:
        for pattern in (pattern for pattern in patterns if pattern.kind != "off"):
            limits = "; ".join(note.partition(": ")[2] for note in unsupported(pattern, capabilities))
            announce(f"{pattern.name:10} {numbers_text(pattern)}" + (f"  ({limits})" if limits else ""))
            play_pattern(guard, pattern, duration_ns(pattern) or CONTINUOUS_NS, clock)
            play_pattern(guard, OFF, PAUSE_NS, clock)
    finally:
        test.end(guard)
    return test


def play_pattern(
    guard: Guard,
    pattern: Pattern,
    length_ns: int,
    clock: Clock,
    sent: Callable[[int], None] = lambda stamp_ns: None,
) -> None:
    """Send a pattern at the image rate, and advance the guard at its edges in between.

    Args:
        guard: Drives the device.
        pattern: What to play, from its start.
        length_ns: For how long.
        clock: Paces the playback.
        sent: Called with the time of every command.
    """
    since_ns = now_ns = clock.now_ns()
    while now_ns < since_ns + length_ns:
        guard.send(guarded_step(pattern, now_ns, since_ns), now_ns)
        sent(now_ns)
        advance_until(guard, min(now_ns + IMAGE_NS, since_ns + length_ns), clock)
        now_ns = clock.now_ns()


def advance_until(guard: Guard, until_ns: int, clock: Clock) -> None:
    """Advance the guard at its edges until a time."""
    while (now_ns := clock.now_ns()) < until_ns:
        edge_ns = guard.next_edge_ns()
        clock.wait_until(until_ns if edge_ns is None else min(max(edge_ns, now_ns), until_ns))
        guard.advance(clock.now_ns())


def guarded_step(pattern: Pattern, now_ns: int, since_ns: int) -> Step:
    """Return a step, as the guard takes it, that commands a pattern without an image.

    Args:
        pattern: The pattern.
        now_ns: The present.
        since_ns: When the pattern began.
    """
    observation, graph = Observation(now_ns), SceneGraph(now_ns)
    conclusion = Conclusion(now_ns, "test", 0, pattern.name, "the device is tested")
    return Step(0, now_ns, observation, graph, conclusion, HapticCommand(now_ns, pattern, since_ns))


def numbers_text(pattern: Pattern) -> str:
    """Return a pattern's numbers as a clause."""
    frequency = f" at {pattern.frequency_hz:g} Hz" if pattern.frequency_hz else ""
    rhythm = f", {pattern.on_ms:g} ms on, {pattern.off_ms:g} ms off" if pattern.on_ms else ""
    repeats = f", {pattern.count} times" if pattern.count else ""
    return f"amplitude {pattern.amplitude:g}{frequency}{rhythm}{repeats}"


def _capability_cells(capabilities: Capabilities) -> tuple[str, ...]:
    low, high = capabilities.frequency_range_hz or (0.0, 0.0)
    return (
        f"{capabilities.amplitude_levels}",
        f"{low:g} to {high:g} Hz" if capabilities.frequency_range_hz else "fixed",
        f"{capabilities.shortest_on_ms:g} ms",
        f"{capabilities.max_rate_hz:g}/s" if capabilities.max_rate_hz else "unlimited",
    )
