"""HJIF: MPEG's haptics, ISO/IEC 23090-31, as JSON; not checked against a reference reader.

Written from the public source and examples of MPEG's reference software (HapticReferenceSoftware on GitHub).
Reads and writes vectorial waves and transients, of the first vibrotactile channel.
"""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from haptigraph.haptics.formats.curve import Curve, Layer, strongest
from haptigraph.haptics.formats.envelope import TRANSIENT_MS, Envelope, Transient, pieces
from haptigraph.haptics.formats.reading import Json, points_checked, read_json, to_bytes
from haptigraph.haptics.tone import DEFAULT_HZ

__all__ = ["read", "write"]

REPEATS = " (repeats)"
TIMESCALE, FINE_TIMESCALE = 1_000, 48_000  # ticks per second; the latter is the largest of the Main profile
MAX_EFFECTS = 2_000
MAX_HZ = 1_000
WAVE, CLICK = "VectorialWave", "Transient"
VIBROTACTILE = "Vibrotactile"


class _Band:
    """What is read of one band.

    Args:
        band: The band.
        library: Effects that others refer to, by their id.
        tick_ms: Unit of time.
        gain: Of the channel.
    """

    def __init__(self, band: Json, library: Mapping[int, Json], tick_ms: float, gain: float) -> None:
        self.layers: list[Layer] = []
        self.transients: list[Transient] = []
        self.notes: list[str] = []
        self._library, self._tick_ms, self._gain = library, tick_ms, gain
        kind = band["band_type"].text()
        if kind not in (WAVE, CLICK):
            self.notes.append(f"a band of type {kind!r:.30} left out")
            return
        effects = band["effects"].items()
        if len(effects) > MAX_EFFECTS:
            raise band["effects"].error(f"{len(effects)} effects; at most {MAX_EFFECTS}")
        for effect in effects:
            start_ms = effect["position"].time_ms(tick_ms)
            basis = self._basis(effect)
            if basis is None:
                self.notes.append("a composed effect left out")
            elif kind == WAVE:
                self._read_wave(basis, start_ms)
            else:
                self._read_transients(basis, start_ms)

    def _basis(self, effect: Json) -> Json | None:
        """Return the effect that has the keyframes; None if it is composed of others."""
        kind = effect["effect_type"].text()
        if kind == "Reference":
            number = effect["id"].value
            if not isinstance(number, int) or number not in self._library:
                raise effect["id"].error(f"no effect {number!r:.20} in effect_library")
            effect = self._library[number]
            kind = effect["effect_type"].text()
        return effect if kind == "Basis" else None

    def _read_wave(self, effect: Json, start_ms: float) -> None:
        base = effect.get("base_signal")
        if base is not None and base.value != "Sine":
            self.notes.append(f"a {base.value!r:.20} wave is read as a sine")
        source = effect["keyframes"]
        amplitude: list[tuple[float, float]] = []
        frequency_hz: list[tuple[float, float]] = []
        last_ms = start_ms
        for keyframe in source.items():
            place = keyframe.get("relative_position")
            last_ms = start_ms + (place.time_ms(self._tick_ms) if place is not None else 0.0)
            if (level := keyframe.get("amplitude_modulation")) is not None:
                amplitude.append((last_ms, self._level(level)))
            if (hertz := keyframe.get("frequency_modulation")) is not None:
                frequency_hz.append((last_ms, hertz.number(0.0, MAX_HZ * 10.0)))
        points_checked(frequency_hz, source)
        if points_checked(amplitude, source):
            whole = _held(amplitude, start_ms, max(last_ms, amplitude[-1][0]))
            self.layers.append(Layer(whole, tuple(frequency_hz)))

    def _read_transients(self, effect: Json, start_ms: float) -> None:
        for keyframe in effect["keyframes"].items():
            place, hertz = keyframe.get("relative_position"), keyframe.get("frequency_modulation")
            at_ms = start_ms + (place.time_ms(self._tick_ms) if place is not None else 0.0)
            frequency_hz = hertz.number(0.0, MAX_HZ * 10.0) if hertz is not None else 0.0
            level = self._level(keyframe["amplitude_modulation"])
            self.transients.append(Transient(at_ms, level, frequency_hz))

    def _level(self, amplitude: Json) -> float:
        return min(abs(amplitude.number(-1.0, 1.0)) * self._gain, 1.0)


def read(content: bytes, file: str) -> Envelope:
    """Return the envelope in a file; where effects overlap, the strongest counts.

    Raises:
        BadInput: If it is not valid, or has no vibration that can be read.
    """
    document = read_json(content, file)
    timescale = document.get("timescale")
    tick_ms = 1e3 / timescale.number(1, 1e6) if timescale is not None else 1e3 / TIMESCALE
    perceptions = document["perceptions"].items()
    vibrations = [each for each in perceptions if each["perception_modality"].text() == VIBROTACTILE]
    if not vibrations:
        raise document["perceptions"].error(f"no perception of modality {VIBROTACTILE!r}")
    channels = vibrations[0]["channels"].items()
    if not channels:
        raise vibrations[0]["channels"].error("no channel; at least one is needed")
    notes = [f"first of {len(perceptions)} perceptions"] if len(perceptions) > 1 else []
    notes += [f"first of {len(channels)} channels"] if len(channels) > 1 else []
    gain = channels[0].get("gain")
    level = gain.number(0.0, 1e3) if gain is not None else 1.0
    library = vibrations[0].get("effect_library")
    known = {
        int(each["id"].number(0, 1e9)): each for each in (library.items() if library is not None else ())
    }
    bands = [_Band(band, known, tick_ms, level) for band in channels[0]["bands"].items()]
    layers = [layer for band in bands for layer in band.layers]
    transients = [transient for band in bands for transient in band.transients]
    notes += [note for band in bands for note in band.notes]
    if len(layers) > MAX_EFFECTS:
        raise channels[0]["bands"].error(f"{len(layers)} effects; at most {MAX_EFFECTS}")
    ends_ms = [layer.amplitude[-1][0] for layer in layers]
    end_ms = max([*ends_ms, *(one.time_ms + TRANSIENT_MS for one in transients)], default=0.0)
    if not end_ms:
        left = f" ({'; '.join(dict.fromkeys(notes))})" if notes else ""
        raise channels[0]["bands"].error(f"no {WAVE} and no {CLICK}, which can be read{left}")
    merged = strongest(layers, end_ms)
    described = document.get("description")
    repeats = described is not None and described.text("").endswith(REPEATS)
    found = tuple(sorted(transients, key=lambda one: one.time_ms))
    return Envelope(merged.amplitude, merged.frequency_hz, found, repeats, tuple(dict.fromkeys(notes)))


def write(envelope: Envelope, name: str) -> bytes:
    """Return an envelope as a file of the Main profile, level 1.

    A vibration without a frequency gets 160 Hz, which the format needs.
    """
    parts = pieces(envelope)
    curves = [curve for part in parts for curve in (part.amplitude, part.frequency_hz)]
    times_ms = [time_ms for curve in curves for time_ms, _ in curve] + [
        one.time_ms for one in envelope.transients
    ]
    is_whole = all(float(time_ms).is_integer() for time_ms in times_ms)
    timescale = TIMESCALE if is_whole else FINE_TIMESCALE
    bands = [_band(WAVE, [_effect(part, timescale) for part in parts])]
    if envelope.transients:
        keyframes = [_transient(one, timescale) for one in envelope.transients]
        bands.append(_band(CLICK, [_basis(0, keyframes)]))
    channel = {
        "id": 0,
        "description": name,
        "gain": 1.0,
        "mixing_coefficient": 1.0,
        "body_part_mask": 0,
        "bands": bands,
    }
    perception = {
        "id": 0,
        "avatar_id": 0,
        "description": name,
        "perception_modality": VIBROTACTILE,
        "reference_devices": [],
        "effect_library": [],
        "channels": [channel],
    }
    return to_bytes(
        {
            "version": "2023",
            "profile": "Main",
            "level": 1,
            "date": datetime.now(UTC).date().isoformat(),
            "description": name + REPEATS * envelope.repeats,
            "timescale": timescale,
            "avatars": [],
            "perceptions": [perception],
            "syncs": [{"timestamp": 0, "timescale": timescale}],
        }
    )


def _held(amplitude: Sequence[tuple[float, float]], start_ms: float, end_ms: float) -> Curve:
    """Return the amplitude of an effect from its start to its last keyframe."""
    before = [(start_ms, amplitude[0][1])] if amplitude[0][0] > start_ms else []
    after = [(end_ms, amplitude[-1][1])] if amplitude[-1][0] < end_ms else []
    return (*before, *amplitude, *after)


def _effect(part: Layer, timescale: int) -> dict[str, Any]:
    """Return one piece of an envelope as an effect."""
    start = _ticks(part.amplitude[0][0], timescale)
    frames: dict[int, dict[str, Any]] = {}
    for time_ms, value in part.amplitude:
        at = _ticks(time_ms, timescale) - start
        frames.setdefault(at, {"relative_position": at})["amplitude_modulation"] = value
    ends_ms = (part.amplitude[0][0], part.amplitude[-1][0])
    for time_ms, value in part.frequency_hz or tuple((time_ms, 0.0) for time_ms in ends_ms):
        at = _ticks(time_ms, timescale) - start
        frames.setdefault(at, {"relative_position": at})["frequency_modulation"] = _hertz(value)
    return _basis(start, [frames[at] for at in sorted(frames)])


def _transient(one: Transient, timescale: int) -> dict[str, Any]:
    at = _ticks(one.time_ms, timescale)
    return {
        "relative_position": at,
        "amplitude_modulation": one.amplitude,
        "frequency_modulation": _hertz(one.frequency_hz),
    }


def _basis(position: int, keyframes: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "effect_type": "Basis",
        "position": position,
        "phase": 0.0,
        "base_signal": "Sine",
        "keyframes": keyframes,
    }


def _band(kind: str, effects: list[dict[str, Any]]) -> dict[str, Any]:
    limits = {"lower_frequency_limit": 0, "upper_frequency_limit": MAX_HZ}
    return {"band_type": kind, "curve_type": "Unknown", **limits, "effects": effects}


def _ticks(time_ms: float, timescale: int) -> int:
    return round(time_ms * timescale / 1e3)


def _hertz(frequency_hz: float) -> int:
    return min(round(frequency_hz or DEFAULT_HZ), MAX_HZ)
