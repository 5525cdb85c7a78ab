"""Claims about touch: every pattern is felt, and an alarm at once, strongest, repeated and unlike all else.

Turns the kinds of a procedure's states and its haptic grammar into claims. Limits and their sources are in
docs/explanation/rules.md.
"""

from collections.abc import Iterator
from typing import NamedTuple

from msgspec.structs import replace

from haptigraph.haptics.pattern import unsupported
from haptigraph.haptics.profiles.profile import DeviceProfile
from haptigraph.inference.meaning import Kind
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Capabilities, Pattern
from haptigraph.proof.claims.felt import (
    AMPLITUDE_JND,
    SHORTEST_PAUSE_MS,
    Felt,
    are_alike,
    felt,
    values_of,
)
from haptigraph.proof.report import Claim, Violation

__all__ = ["device_claims", "haptic_claims"]

MIN_AMPLITUDE, MIN_ALARM_AMPLITUDE, MIN_ONCE_AMPLITUDE = 0.1, 0.2, 0.2
"""Of the device's full amplitude."""
MIN_ON_MS, MAX_PULSE_PAUSE_MS, MAX_BURST_PAUSE_MS, MAX_BURSTS_MS = 20.0, 2000.0, 500.0, 1000.0
MIN_ALARM_ON_MS, MAX_ALARM_PAUSE_MS, MAX_ALARM_PERIOD_MS = 50.0, 500.0, 1000.0
MIN_HZ, MAX_HZ, MIN_CYCLES = 20.0, 500.0, 2.0


class _Use(NamedTuple):
    """A pattern, and a state in which it is felt."""

    state: str
    kind: Kind
    felt: Felt


def haptic_claims(procedure: Procedure) -> list[Claim]:
    """Return the claims about the haptic grammar of a procedure."""
    uses = _uses(procedure)
    alarms = [use for use in uses if use.kind == "alarm"]
    nothing = "" if alarms else " (no state is an alarm)"
    return [
        Claim(
            "felt",
            f"what vibrates is felt: amplitude {MIN_AMPLITUDE:g} or more, {MIN_ONCE_AMPLITUDE:g} if it "
            f"plays once, bursts of {MIN_ON_MS:g} ms and {MIN_CYCLES:g} cycles or more, {MIN_HZ:g} to "
            f"{MAX_HZ:g} Hz, pauses that are felt as part of it",
            tuple(_unfelt(procedure)),
        ),
        Claim(
            "alarm felt",
            f"an alarm is felt within {MIN_ALARM_ON_MS:g} ms and repeats within {MAX_ALARM_PERIOD_MS:g} ms, "
            f"with pauses of at most {MAX_ALARM_PAUSE_MS:g} ms{nothing}",
            tuple(_weak_alarms(procedure)),
        ),
        Claim(
            "alarm strongest",
            f"an alarm is at least {AMPLITUDE_JND * 100:g} % stronger than all else, "
            f"and no weaker than success{nothing}",
            tuple(_overpowered(uses)),
        ),
        Claim(
            "alarm unlike",
            f"an alarm differs in rhythm, frequency or strength from all else{nothing}",
            tuple(_confused(uses)),
        ),
    ]


def device_claims(
    procedure: Procedure, name: str, device: Capabilities, profile: DeviceProfile | None = None
) -> list[Claim]:
    """Return the claims about a haptic grammar as one device plays it.

    Args:
        procedure: A checked procedure.
        name: The device's name.
        device: Its capabilities.
        profile: How strong it feels; None: amplitudes are taken as its strength.
    """
    uses = _uses(procedure, device, profile)
    return [
        Claim("device", f"{name} can play every pattern", tuple(_beyond(procedure, device))),
        Claim(
            "device alarm",
            f"an alarm stays the strongest and unlike all else as {name} plays it",
            (*_overpowered(uses), *_confused(uses)),
        ),
    ]


def _uses(
    procedure: Procedure, device: Capabilities | None = None, profile: DeviceProfile | None = None
) -> list[_Use]:
    """Return what is felt in every state that vibrates."""
    patterns = {pattern.name: pattern for pattern in procedure.patterns}
    kinds = procedure.kinds
    return [
        _Use(state.name, kinds[state.name], felt(patterns[state.feel], device, profile))
        for state in procedure.states
        if patterns[state.feel].kind != "off"
    ]


def _unfelt(procedure: Procedure) -> Iterator[Violation]:
    for pattern in procedure.patterns:
        reasons = (reason for value in values_of(pattern) for reason in _reasons_unfelt(value))
        for reason in dict.fromkeys(reasons):
            yield Violation(f"{pattern.name!r} {reason}", f"pattern {pattern.name}")


def _reasons_unfelt(pattern: Pattern) -> Iterator[str]:
    """Yield why a pattern of plain numbers is not felt as written."""
    if pattern.kind == "off":
        return
    hz, on_ms = pattern.frequency_hz, pattern.on_ms
    if pattern.amplitude < MIN_AMPLITUDE:
        yield f"has amplitude {pattern.amplitude:g}, which is not felt; give at least {MIN_AMPLITUDE:g}"
    elif pattern.kind == "bursts" and pattern.amplitude < MIN_ONCE_AMPLITUDE:
        yield (
            f"has amplitude {pattern.amplitude:g}, which may be missed, because it plays once; "
            f"give at least {MIN_ONCE_AMPLITUDE:g}"
        )
    if hz and not MIN_HZ <= hz <= MAX_HZ:
        yield f"vibrates at {hz:g} Hz, which skin does not feel; give {MIN_HZ:g} to {MAX_HZ:g} Hz"
    if pattern.kind == "continuous":
        return
    if on_ms < MIN_ON_MS:
        yield f"has bursts of {on_ms:g} ms, which are not felt; give on_ms of at least {MIN_ON_MS:g}"
    elif hz >= MIN_HZ and on_ms * hz / 1000 < MIN_CYCLES:
        yield (
            f"has bursts of {on_ms:g} ms, {on_ms * hz / 1000:.2g} cycles of {hz:g} Hz; "
            f"give at least {MIN_CYCLES:g} cycles"
        )
    if pattern.count != 1:
        yield from _reasons_without_rhythm(pattern)
    length_ms = pattern.count * on_ms + (pattern.count - 1) * pattern.off_ms
    if pattern.kind == "bursts" and length_ms > MAX_BURSTS_MS:
        yield (
            f"goes on for {length_ms:g} ms after its state is entered, even if that is over; "
            f"give at most {MAX_BURSTS_MS:g} ms"
        )


def _reasons_without_rhythm(pattern: Pattern) -> Iterator[str]:
    """Yield why the pauses of a pattern are not felt, or not as part of it."""
    if pattern.off_ms < SHORTEST_PAUSE_MS:
        yield (
            f"has pauses of {pattern.off_ms:.3g} ms, which are not felt, so it has no rhythm; "
            f"give at least {SHORTEST_PAUSE_MS:g} ms"
        )
    longest_ms = MAX_BURST_PAUSE_MS if pattern.kind == "bursts" else MAX_PULSE_PAUSE_MS
    if pattern.off_ms > longest_ms:
        yield (
            f"pauses for {pattern.off_ms:g} ms, so it is felt as separate events; "
            f"give at most {longest_ms:g} ms"
        )


def _weak_alarms(procedure: Procedure) -> Iterator[Violation]:
    patterns = {pattern.name: pattern for pattern in procedure.patterns}
    kinds = procedure.kinds
    for state in procedure.states:
        if kinds[state.name] == "alarm":
            pattern = patterns[state.feel]
            reasons = (reason for value in values_of(pattern) for reason in _reasons_weak(value))
            for reason in dict.fromkeys(reasons):
                sentence = f"the alarm {state.name!r} feels {pattern.name!r}, which {reason}"
                yield Violation(sentence, f"state {state.name}")


def _reasons_weak(pattern: Pattern) -> Iterator[str]:
    """Yield why a pattern of plain numbers is no alarm."""
    if pattern.kind == "off":
        yield "is silence; give it a pattern that is felt, or another kind"
        return
    if pattern.kind == "bursts":
        yield "plays once; an alarm repeats until it is over: use kind pulses or continuous"
    if pattern.amplitude < MIN_ALARM_AMPLITUDE:
        yield f"has amplitude {pattern.amplitude:g}; an alarm has at least {MIN_ALARM_AMPLITUDE:g}"
    if pattern.kind != "continuous" and pattern.on_ms < MIN_ALARM_ON_MS:
        yield f"has bursts of {pattern.on_ms:g} ms; those of an alarm last at least {MIN_ALARM_ON_MS:g} ms"
    if pattern.kind == "pulses" and pattern.off_ms > MAX_ALARM_PAUSE_MS:
        yield f"pauses for {pattern.off_ms:g} ms; an alarm pauses for at most {MAX_ALARM_PAUSE_MS:g} ms"
    elif pattern.kind == "pulses" and pattern.on_ms + pattern.off_ms > MAX_ALARM_PERIOD_MS:
        yield (
            f"repeats every {pattern.on_ms + pattern.off_ms:g} ms; an alarm repeats within "
            f"{MAX_ALARM_PERIOD_MS:g} ms"
        )


def _pairs(uses: list[_Use]) -> Iterator[tuple[_Use, _Use]]:
    """Yield each alarm with each state of another kind that vibrates; the same two patterns once."""
    seen = set()
    for alarm in uses:
        for other in uses:
            pair = alarm.felt.name, other.felt.name, other.kind == "success"
            if alarm.kind == "alarm" and other.kind != "alarm" and pair not in seen:
                seen.add(pair)
                yield alarm, other


def _overpowered(uses: list[_Use]) -> Iterator[Violation]:
    for alarm, other in _pairs(uses):
        low, high = alarm.felt.amplitude.low, other.felt.amplitude.high
        least = high if other.kind == "success" else high * (1 + AMPLITUDE_JND)
        if low < least - 1e-9:
            give = f"give the alarm {least:.3g} or more" if least <= 1 else f"weaken {other.felt.name!r}"
            sentence = (
                f"the alarm {alarm.state!r} feels {alarm.felt.name!r} of amplitude {low:g}, but "
                f"{other.state!r} ({other.kind}) feels {other.felt.name!r} of {high:g}; {give}"
            )
            yield Violation(sentence, f"pattern {alarm.felt.name}")


def _confused(uses: list[_Use]) -> Iterator[Violation]:
    for alarm, other in _pairs(uses):
        if are_alike(alarm.felt, other.felt):
            how = (
                f"the same pattern, {other.felt.name!r}"
                if alarm.felt.name == other.felt.name
                else f"{alarm.felt.name!r} and {other.felt.name!r}, which cannot be distinguished"
            )
            sentence = (
                f"the alarm {alarm.state!r} and {other.state!r} ({other.kind}) feel {how}; "
                "give one another rhythm or frequency"
            )
            yield Violation(sentence, f"pattern {alarm.felt.name}")


def _beyond(procedure: Procedure, device: Capabilities) -> Iterator[Violation]:
    """Yield what a device cannot do; a frequency is a request to devices that can choose one."""
    is_fixed = device.frequency_range_hz is None
    patterns = procedure.patterns
    for pattern in (replace(one, frequency_hz=0.0) for one in patterns) if is_fixed else patterns:
        sentences = (sentence for value in values_of(pattern) for sentence in unsupported(value, device))
        for sentence in dict.fromkeys(sentences):
            yield Violation(sentence, f"pattern {pattern.name}")
