"""`.haptic`, version 1: Meta Haptics Studio and its SDK, before that Lofelt's; JSON.

One amplitude envelope, optionally one of frequency, with breakpoints; an amplitude breakpoint may carry an
emphasis, which is a transient. Written from the description of the data model that Meta publishes.
"""

from operator import itemgetter

from haptigraph.haptics.formats.curve import Curve, value_after
from haptigraph.haptics.formats.envelope import Envelope, Transient
from haptigraph.haptics.formats.reading import (
    Json,
    normalised,
    points_checked,
    read_json,
    to_bytes,
    to_hz,
)
from haptigraph.version import __version__

__all__ = ["read", "write"]

REPEATS = "haptigraph:repeats"
STEP_MS = 0.005  # no two breakpoints at one time, on which readers differ
MIDDLE = 0.5  # an emphasis needs a frequency


def read(content: bytes, file: str) -> Envelope:
    """Return the envelope in a file.

    Raises:
        BadInput: If it is not a valid file of version 1.
    """
    document = read_json(content, file)
    major = document["version"]["major"]
    if major.value != 1:
        raise major.error(f"version {major.value!r:.20} of the format; version 1 can be read")
    envelopes = document["signals"]["continuous"]["envelopes"]
    source = envelopes["amplitude"]
    breakpoints = [(point["time"].time_ms(), point) for point in source.items()]
    if not breakpoints:
        raise source.error("no breakpoints; at least one is needed")
    levels = [(time_ms, point["amplitude"].number(0.0, 1.0)) for time_ms, point in breakpoints]
    amplitude = points_checked(levels, source)
    if amplitude[0][0] > 0:
        amplitude = ((0.0, 0.0), (amplitude[0][0], 0.0), *amplitude)
    if amplitude[-1][0] <= 0:
        raise source.error("ends at 0 s; the last breakpoint must come later")
    transients = []
    for time_ms, point in breakpoints:
        if (emphasis := point.get("emphasis")) is not None:
            level = emphasis["amplitude"].number(0.0, 1.0)
            transients.append(Transient(time_ms, level, to_hz(emphasis["frequency"].number(0.0, 1.0))))
    return Envelope(amplitude, _frequency(envelopes), tuple(transients), _repeats(document))


def write(envelope: Envelope, name: str) -> bytes:
    """Return an envelope as a file; a step becomes a ramp of 5 us."""
    amplitude = [_breakpoint(time_ms, "amplitude", value) for time_ms, value in _ramped(envelope.amplitude)]
    for one in envelope.transients:
        emphasised = _breakpoint(one.time_ms, "amplitude", value_after(envelope.amplitude, one.time_ms))
        frequency = normalised(one.frequency_hz) if one.frequency_hz else MIDDLE
        emphasis = {"amplitude": one.amplitude, "frequency": frequency}
        amplitude.append({**emphasised, "emphasis": emphasis})
    envelopes = {"amplitude": sorted(amplitude, key=itemgetter("time"))}
    if envelope.frequency_hz:
        envelopes["frequency"] = [
            _breakpoint(time_ms, "frequency", normalised(value))
            for time_ms, value in _ramped(envelope.frequency_hz)
        ]
    return to_bytes(
        {
            "version": {"major": 1, "minor": 0, "patch": 0},
            "metadata": {
                "editor": f"haptigraph {__version__}",
                "project": name,
                "tags": [REPEATS] * envelope.repeats,
            },
            "signals": {"continuous": {"envelopes": envelopes}},
        }
    )


def _frequency(envelopes: Json) -> Curve:
    source = envelopes.get("frequency")
    if source is None:
        return ()
    breakpoints = source.items()
    levels = [(point["time"].time_ms(), to_hz(point["frequency"].number(0.0, 1.0))) for point in breakpoints]
    return points_checked(levels, source)


def _repeats(document: Json) -> bool:
    metadata = document.get("metadata")
    tags = metadata.get("tags") if metadata is not None and metadata.value is not None else None
    return tags is not None and tags.value is not None and REPEATS in [tag.value for tag in tags.items()]


def _ramped(curve: Curve) -> Curve:
    """Return a curve in which a step takes `STEP_MS`, and ends where it was."""
    following = (*curve[1:], (-1.0, 0.0))
    points = [
        (max(time_ms - STEP_MS, 0.0), value) if after[0] == time_ms else (time_ms, value)
        for (time_ms, value), after in zip(curve, following, strict=True)
    ]
    return tuple(sorted(points, key=lambda point: point[0]))


def _breakpoint(time_ms: float, key: str, value: float) -> dict[str, object]:
    return {"time": round(time_ms / 1e3, 9), key: value}
