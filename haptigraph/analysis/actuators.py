"""What could vibrate here, and how one device plays the haptic grammar.

Knows devices by their registry and Protocol; a class that can look for its hardware has a static `found()`.
"""

import time
from collections.abc import Callable, Sequence
from importlib import import_module

from rich.table import Table

from haptigraph.assemble import DEVICES
from haptigraph.clock import Clock
from haptigraph.config import HapticsConfig
from haptigraph.errors import HaptigraphError, MissingExtra
from haptigraph.graph import SceneGraph
from haptigraph.haptics.guard import Guard
from haptigraph.haptics.observed_device import PAGE_CONTROLLER
from haptigraph.haptics.pattern import beyond, duration_ns
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
from haptigraph.run_report import Durations
from haptigraph.stages import Device

__all__ = ["Trial", "actuators", "play_grammar"]

ALWAYS = {"audio": "audio:FILE.wav", "console": "console", "trace": "trace:FILE.csv"}
PLAYED_NS, PAUSE_NS, NEWS_NS = 1_500_000_000, 500_000_000, 33_000_000


def actuators() -> tuple[Table, list[str]]:
    """Return a table of all devices (what to give, what is there, what it can), and what each does else."""
    table = Table(title="Haptic devices", title_justify="left")
    for heading in ("device", "here", "strengths", "frequency", "shortest", "changes"):
        table.add_column(heading, overflow="fold")
    rest = []
    for kind, path in sorted(DEVICES.items()):
        module, _, name = path.partition(":")
        cls = getattr(import_module(module), name)
        here = {ALWAYS[kind]: "always"} if kind in ALWAYS else {}
        try:
            here |= getattr(cls, "found", dict)()
        except MissingExtra as missing:
            here[f"{kind}:..."] = str(missing)
        except HaptigraphError as error:
            here[f"{kind}:..."] = f"cannot be used: {error}"
        here = here or {f"{kind}:...": "none found"}
        table.add_row("\n".join(here), "\n".join(here.values()), *_told(cls.capabilities))
        rest.append(f"{kind:8} {cls.capabilities.limitations}")
    table.add_row("-", "a controller on the page: haptigraph live", *_told(PAGE_CONTROLLER))
    return table, rest


class Trial:
    """What a device did with the grammar.

    Args:
        device: The device; how long it takes to be told is measured, and that is a round trip if it answers.
    """

    def __init__(self, device: Device) -> None:
        self.capabilities = device.capabilities
        self.told = Durations()
        self.count = 0
        self.faults: list[Fault] = []
        self._device = device

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Tell the device."""
        begun_ns = time.perf_counter_ns()
        self._device.set(amplitude, frequency_hz, stamp_ns)
        self.told.add(time.perf_counter_ns() - begun_ns)
        self.count += 1

    def close(self) -> None:
        """Close the device."""
        self._device.close()


def play_grammar(
    device: Device, patterns: Sequence[Pattern], clock: Clock, announce: Callable[[str], None]
) -> Trial:
    """Play every pattern through the guard; the hand is still on every way out.

    Args:
        device: The device; closed afterwards.
        patterns: The grammar of a procedure.
        clock: Paces it.
        announce: Told, a line each, what comes.
    """
    trial = Trial(device)
    guard = Guard(trial, HapticsConfig())
    try:
        for pattern in (pattern for pattern in patterns if pattern.kind != "off"):
            limits = "; ".join(note.partition(": ")[2] for note in beyond(pattern, device.capabilities))
            announce(f"{pattern.name:10} {_asked(pattern)}" + (f"  ({limits})" if limits else ""))
            _play(guard, pattern, duration_ns(pattern) or PLAYED_NS, clock)
            _play(guard, OFF, PAUSE_NS, clock)
    finally:
        guard.close()
        trial.faults = list(guard.take_faults())
    return trial


def _play(guard: Guard, pattern: Pattern, length_ns: int, clock: Clock) -> None:
    """Send a pattern as often as images come, edge by edge in between."""
    since_ns = now_ns = clock.now_ns()
    while now_ns < since_ns + length_ns:
        guard.send(_step(pattern, now_ns, since_ns), now_ns)
        news_ns = min(now_ns + NEWS_NS, since_ns + length_ns)
        while (now_ns := clock.now_ns()) < news_ns:
            edge_ns = guard.next_edge_ns()
            clock.wait_until(news_ns if edge_ns is None else min(edge_ns, news_ns))
            guard.advance(clock.now_ns())


def _step(pattern: Pattern, now_ns: int, since_ns: int) -> Step:
    observation, graph = Observation(now_ns), SceneGraph(now_ns)
    conclusion = Conclusion(now_ns, "test", 0, pattern.name, "the device is tested")
    return Step(0, now_ns, observation, graph, conclusion, HapticCommand(now_ns, pattern, since_ns))


def _asked(pattern: Pattern) -> str:
    frequency = f" at {pattern.frequency_hz:g} Hz" if pattern.frequency_hz else ""
    rhythm = f", {pattern.on_ms:g} ms on, {pattern.off_ms:g} ms off" if pattern.on_ms else ""
    times = f", {pattern.count} times" if pattern.count else ""
    return f"amplitude {pattern.amplitude:g}{frequency}{rhythm}{times}"


def _told(can: Capabilities) -> tuple[str, ...]:
    low, high = can.frequency_range_hz or (0.0, 0.0)
    return (
        f"{can.amplitude_levels}",
        f"{low:g} to {high:g} Hz" if can.frequency_range_hz else "its own",
        f"{can.shortest_on_ms:g} ms",
        f"{can.max_rate_hz:g}/s" if can.max_rate_hz else "any",
    )
