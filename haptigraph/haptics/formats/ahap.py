"""AHAP: Apple's Core Haptics; JSON with transient and continuous events, and curves that modulate them.

Written from Apple's documentation, "Representing haptic patterns in AHAP files". The format has neither a
duration nor repetition; a silent event and an entry in the metadata stand for them.
"""

import itertools
from collections.abc import Sequence
from typing import Any

from haptigraph.haptics.formats.curve import Curve, Layer, strongest, value_after, value_before
from haptigraph.haptics.formats.envelope import TRANSIENT_MS, Envelope, Transient, pieces, plain
from haptigraph.haptics.formats.reading import Json, normalised, points_checked, read_json, to_bytes, to_hz

__all__ = ["read", "write"]

REPEATS = "haptigraph repeats"
MAX_EVENTS = 2_000
MAX_CONTROL_POINTS = 16  # of a curve, as Lofelt's converter splits them for Core Haptics
INTENSITY, SHARPNESS = "HapticIntensity", "HapticSharpness"
DEFAULT = 0.5
MAX_NAMES = 6  # in a note
ENTRIES = ("Event", "Parameter", "ParameterCurve")
CONTINUOUS, TRANSIENT = "HapticContinuous", "HapticTransient"


class _Controls:
    """The curves that modulate all events: intensity is multiplied, sharpness added."""

    def __init__(self, entries: Sequence[Json]) -> None:
        self.intensity = _control(entries, f"{INTENSITY}Control", neutral=1.0)
        self.sharpness = _control(entries, f"{SHARPNESS}Control", neutral=0.0)


class _Event:
    """A haptic event: its time, intensity and sharpness."""

    def __init__(self, entry: Json, notes: list[str]) -> None:
        self.time_ms = entry["Time"].time_ms()
        self.kind = entry["EventType"].text()
        is_continuous = self.kind == CONTINUOUS
        self.duration_ms = entry["EventDuration"].time_ms() if is_continuous else TRANSIENT_MS
        given = entry.get("EventParameters")
        values: dict[str, float] = {}
        for parameter in given.items() if given is not None else ():
            values[parameter["ParameterID"].text()] = parameter["ParameterValue"].number(-1e6, 1e6)
        if INTENSITY not in values:
            notes.append(f"an event without intensity is read as {DEFAULT:g}")
        if any(not 0 <= values.get(key, 0.0) <= 1 for key in (INTENSITY, SHARPNESS)):
            notes.append("intensity or sharpness outside 0 to 1 is limited to it")
        if others := sorted(values.keys() - {INTENSITY, SHARPNESS}):
            notes.append(f"{', '.join(f'{other!r:.30}' for other in others[:MAX_NAMES])} left out")
        self.intensity = _share(values.get(INTENSITY, DEFAULT))
        self.sharpness = _share(values[SHARPNESS]) if SHARPNESS in values else None

    def hz(self, share: float, *, is_controlled: bool) -> float:
        """Return the frequency with a share added to the sharpness; 0 if nothing states one."""
        if self.sharpness is None and not is_controlled:
            return 0.0
        return to_hz(_share((DEFAULT if self.sharpness is None else self.sharpness) + share))


def read(content: bytes, file: str) -> Envelope:
    """Return the envelope in a file; where events overlap, the strongest counts.

    Raises:
        BadInput: If it is not valid, or has no haptic event.
    """
    document = read_json(content, file)
    entries = document["Pattern"].items()
    controls, notes = _Controls(entries), list[str]()
    given = [event for entry in entries if (event := _checked(entry).get("Event")) is not None]
    events = []
    for entry in given:
        kind = entry["EventType"]
        if kind.text() in (CONTINUOUS, TRANSIENT):
            events.append(_Event(entry, notes))
        elif kind.text() in ("AudioContinuous", "AudioCustom"):
            notes.append("sound left out")
        else:
            raise kind.error(
                f"unknown event {kind.text()!r:.40}; valid: {CONTINUOUS}, {TRANSIENT}, AudioCustom"
            )
    if not events:
        raise document["Pattern"].error("no haptic event; at least one is needed")
    continuous = [event for event in events if event.kind == CONTINUOUS]
    if len(continuous) > MAX_EVENTS:
        raise document["Pattern"].error(f"{len(continuous)} continuous events; at most {MAX_EVENTS}")
    transients = tuple(_transient(event, controls) for event in events if event.kind == TRANSIENT)
    end_ms = max(event.time_ms + event.duration_ms for event in events)
    if not end_ms:
        raise document["Pattern"].error("lasts 0 s; an event must last longer")
    merged = strongest([_layer(event, controls) for event in continuous], end_ms)
    notes = list(dict.fromkeys(notes))
    return Envelope(merged.amplitude, merged.frequency_hz, transients, _repeats(document), tuple(notes))


def write(envelope: Envelope, name: str) -> bytes:
    """Return an envelope as a file: constant parts are events, others are modulated by curves.

    A curve modulates transients too, so beside one they are written as bursts.
    """
    parts = pieces(envelope)
    has_curves = any(
        len({value for _, value in curve}) > 1
        for part in parts
        for curve in (part.amplitude, part.frequency_hz)
    )
    if has_curves and envelope.transients:
        envelope = plain(envelope)
        parts = pieces(envelope)
    pattern: list[dict[str, Any]] = []
    for part in parts:
        start_ms, end_ms = part.amplitude[0][0], part.amplitude[-1][0]
        intensity = 1.0 if has_curves else part.amplitude[0][1]
        frequency_hz = part.frequency_hz[0][1] if part.frequency_hz else 0.0
        event = _written(
            CONTINUOUS, start_ms, intensity, to_hz(DEFAULT) if has_curves and frequency_hz else frequency_hz
        )
        event["EventDuration"] = _seconds(end_ms - start_ms)
        pattern.append({"Event": event})
    for one in envelope.transients:
        pattern.append({"Event": _written(TRANSIENT, one.time_ms, one.amplitude, one.frequency_hz)})
    if has_curves:
        pattern += _curves(f"{INTENSITY}Control", envelope.amplitude)
        scale = [(time_ms, normalised(value) - DEFAULT) for time_ms, value in envelope.frequency_hz]
        pattern += _curves(f"{SHARPNESS}Control", scale)
    metadata: dict[str, object] = {"Project": name}
    if envelope.repeats:
        metadata[REPEATS] = True
    return to_bytes({"Version": 1.0, "Metadata": metadata, "Pattern": pattern})


def _checked(entry: Json) -> Json:
    """Return an entry of the pattern if its kind is known."""
    if all(entry.get(kind) is None for kind in ENTRIES):
        found = ", ".join(repr(key) for key in entry.value) or "nothing"
        raise entry.error(f"expected one of {', '.join(ENTRIES)}, found {found:.40}")
    return entry


def _control(entries: Sequence[Json], name: str, *, neutral: float) -> Curve:
    """Return the values of a control over time; no points if the file has none."""
    parts: list[tuple[float, list[tuple[float, float]], Json]] = []
    for entry in entries:
        curve, single = entry.get("ParameterCurve"), entry.get("Parameter")
        if curve is not None and curve["ParameterID"].value == name:
            start_ms, source = curve["Time"].time_ms(), curve["ParameterCurveControlPoints"]
            points = [
                (start_ms + point["Time"].time_ms(), point["ParameterValue"].number(-1.0, 1.0))
                for point in source.items()
            ]
            points_checked(points, source)
            parts += [(points[0][0], points, source)] if points else []
        elif single is not None and single["ParameterID"].value == name:
            at_ms = single["Time"].time_ms()
            parts.append((at_ms, [(at_ms, single["ParameterValue"].number(-1.0, 1.0))], single))
    found: list[tuple[float, float]] = []
    for start_ms, points, _ in sorted(parts, key=lambda part: part[0]):
        found.append((start_ms, value_before(found, start_ms, neutral)))
        found += [point for point in points if point[0] >= found[-1][0]]
    return tuple(found)


def _transient(event: _Event, controls: _Controls) -> Transient:
    intensity = event.intensity * _share(value_after(controls.intensity, event.time_ms, 1.0))
    sharpness = value_after(controls.sharpness, event.time_ms)
    return Transient(event.time_ms, intensity, event.hz(sharpness, is_controlled=bool(controls.sharpness)))


def _layer(event: _Event, controls: _Controls) -> Layer:
    """Return a continuous event as it is modulated."""
    start_ms, end_ms = event.time_ms, event.time_ms + event.duration_ms
    times_ms = {time_ms for curve in (controls.intensity, controls.sharpness) for time_ms, _ in curve}
    ordered = [start_ms, *sorted(time_ms for time_ms in times_ms if start_ms < time_ms < end_ms), end_ms]
    amplitude, frequency_hz = [], []
    for since_ms, until_ms in itertools.pairwise(ordered):
        for value, time_ms in ((value_after, since_ms), (value_before, until_ms)):
            amplitude.append((time_ms, event.intensity * _share(value(controls.intensity, time_ms, 1.0))))
            sharpness = value(controls.sharpness, time_ms, 0.0)
            frequency_hz.append((time_ms, event.hz(sharpness, is_controlled=bool(controls.sharpness))))
    return Layer(tuple(amplitude), tuple(frequency_hz))


def _repeats(document: Json) -> bool:
    metadata = document.get("Metadata")
    return metadata is not None and isinstance(metadata.value, dict) and metadata.value.get(REPEATS) is True


def _written(kind: str, start_ms: float, intensity: float, frequency_hz: float) -> dict[str, Any]:
    parameters = [{"ParameterID": INTENSITY, "ParameterValue": intensity}]
    if frequency_hz:
        parameters.append({"ParameterID": SHARPNESS, "ParameterValue": normalised(frequency_hz)})
    return {"Time": _seconds(start_ms), "EventType": kind, "EventParameters": parameters}


def _curves(name: str, curve: Sequence[tuple[float, float]]) -> list[dict[str, Any]]:
    """Return a control as curves of at most `MAX_CONTROL_POINTS`; each begins where the previous one ends."""
    found = []
    for first in range(0, len(curve), MAX_CONTROL_POINTS - 1):
        part = curve[first : first + MAX_CONTROL_POINTS]
        if first and len(part) == 1:
            break
        points = [
            {"Time": _seconds(time_ms - part[0][0]), "ParameterValue": round(value, 9)}
            for time_ms, value in part
        ]
        found.append(
            {
                "ParameterCurve": {
                    "ParameterID": name,
                    "Time": _seconds(part[0][0]),
                    "ParameterCurveControlPoints": points,
                }
            }
        )
    return found


def _seconds(time_ms: float) -> float:
    return round(time_ms / 1e3, 9)


def _share(value: float) -> float:
    return min(max(value, 0.0), 1.0)
