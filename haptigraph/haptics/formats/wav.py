"""WAV: the vibration itself, as a voice coil plays it; PCM.

A pattern is written as sines with short ramps inside its bursts, 48 kHz and 16 bit; a loop in the chunk
`smpl` states that it repeats. A burst that is a sine is read by a fit, any other one window by window.
"""

import io
import struct
import wave

import numpy as np
from numpy.typing import NDArray

from haptigraph.errors import BadInput
from haptigraph.haptics.formats.curve import Curve, cut, reduced
from haptigraph.haptics.formats.envelope import MAX_MS, Envelope, plain
from haptigraph.haptics.tone import DEFAULT_HZ, RATE_HZ

__all__ = ["read", "write"]

Samples = NDArray[np.float64]
RAMP_MS = 5.0
RAMP_SHARE = 0.1  # of a burst, for short ones
MARGIN_SHARE = 0.2
SILENCE_MS = 0.8
SILENT_SHARE = 0.002  # of the peak
MAX_RESIDUAL = 0.05  # of a burst that counts as one sine
WINDOW_MS, HOP_MS = 25.0, 5.0
TOLERANCE = 0.01
MIN_RATE_HZ, MAX_RATE_HZ = 1_000, 192_000
FULL_SCALE = 32_767


def read(content: bytes, file: str) -> Envelope:
    """Return the envelope of the first channel.

    Raises:
        BadInput: If it is not a WAV file with PCM samples, or has none.
    """
    samples, rate_hz, step, notes = _samples(content, file)
    points: list[tuple[float, float]] = [(0.0, 0.0)]
    frequency_hz: list[tuple[float, float]] = []
    for first, last in _bursts(samples, rate_hz, step):
        amplitude, hertz = _burst(samples[first:last], rate_hz)
        start_ms = first / rate_hz * 1e3
        points += [(start_ms, 0.0), *((start_ms + time_ms, value) for time_ms, value in amplitude)]
        points.append((points[-1][0], 0.0))
        frequency_hz += [(start_ms + time_ms, value) for time_ms, value in hertz]
    end_ms = len(samples) / rate_hz * 1e3
    points.append((end_ms, 0.0))
    whole = cut(reduced(points), 0.0, end_ms)
    return Envelope(whole, reduced(frequency_hz), (), _has_loop(content), notes)


def write(envelope: Envelope, name: str) -> bytes:
    """Return an envelope as a file; `name` is not part of it.

    A vibration without a frequency gets 160 Hz, as on a sound card.
    """
    envelope = plain(envelope)
    count = round(envelope.duration_ms / 1e3 * RATE_HZ)
    times_ms = (np.arange(count) + 0.5) / RATE_HZ * 1e3
    amplitude = _at(envelope.amplitude, times_ms)
    frequency_hz = _at(envelope.frequency_hz or ((0.0, 0.0),), times_ms)
    frequency_hz[frequency_hz == 0] = DEFAULT_HZ
    samples = np.zeros(count)
    sounding = np.flatnonzero(np.diff(np.concatenate([[0], (amplitude > 0).astype(int), [0]])))
    for first, last in sounding.reshape(-1, 2):
        turns = np.cumsum(frequency_hz[first:last]) / RATE_HZ
        ramp = _ramp(last - first)
        samples[first:last] = amplitude[first:last] * ramp * np.sin(2 * np.pi * (turns - turns[0]))
    file = io.BytesIO()
    with wave.open(file, "wb") as sound:
        sound.setparams((1, 2, RATE_HZ, 0, "NONE", "not compressed"))
        sound.writeframes(np.round(samples * FULL_SCALE).astype("<i2").tobytes())
    content = file.getvalue()
    return _with_loop(content, count) if envelope.repeats else content


def _samples(content: bytes, file: str) -> tuple[Samples, int, float, tuple[str, ...]]:
    """Return samples of the first channel in [-1, 1], their rate [Hz], the size of a step, and notes."""
    try:
        with wave.open(io.BytesIO(content)) as sound:
            channels, width, rate_hz = sound.getnchannels(), sound.getsampwidth(), sound.getframerate()
            raw = sound.readframes(sound.getnframes())
    except (wave.Error, EOFError, struct.error, ValueError, RuntimeError, ArithmeticError) as error:
        problem = str(error) or "it ends too early"
        raise BadInput(f"not a WAV file with PCM samples ({problem}); save it as 16-bit PCM", file) from None
    if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
        raise BadInput(f"{rate_hz} samples/s; valid: {MIN_RATE_HZ} to {MAX_RATE_HZ}", file)
    if width not in (1, 2, 3, 4):
        raise BadInput(f"samples of {width} bytes; valid: 1 to 4", file)
    count = len(raw) // (width * channels)
    if not 0 < count <= MAX_MS / 1e3 * rate_hz:
        raise BadInput(f"lasts {count / rate_hz:.4g} s; valid: up to {MAX_MS / 1e3:g} s", file)
    frames = np.frombuffer(raw[: count * width * channels], np.uint8).reshape(count, channels, width)
    wide = np.zeros((count, 4), np.uint8)
    wide[:, 4 - width :] = frames[:, 0] ^ 0x80 if width == 1 else frames[:, 0]  # 8-bit samples have no sign
    samples = wide.view("<i4")[:, 0] / 2.0**31
    notes = (f"first of {channels} channels",) if channels > 1 else ()
    return samples, rate_hz, 2.0 ** (1 - 8 * width), notes


def _bursts(samples: Samples, rate_hz: int, step: float) -> list[tuple[int, int]]:
    """Return first sample and end of each part between silences."""
    peak = float(np.abs(samples).max())
    loud = np.flatnonzero(np.abs(samples) > max(SILENT_SHARE * peak, 1.5 * step))
    if not len(loud):
        return []
    gaps = np.flatnonzero(np.diff(loud) > SILENCE_MS / 1e3 * rate_hz)
    firsts, lasts = loud[np.concatenate([[0], gaps + 1])], loud[np.concatenate([gaps, [len(loud) - 1]])]
    return [(int(first), int(last) + 1) for first, last in zip(firsts, lasts, strict=True)]


def _burst(samples: Samples, rate_hz: int) -> tuple[Curve, Curve]:
    """Return amplitude and frequency of a burst over its own time."""
    length_ms = len(samples) / rate_hz * 1e3
    margin = round(min((RAMP_MS + 1) / 1e3 * rate_hz, MARGIN_SHARE * len(samples)))
    inside = samples[margin : len(samples) - margin]
    frequency_hz = _frequency(inside, rate_hz)
    if frequency_hz:
        amplitude, residual = _sine(inside, frequency_hz / rate_hz)
        if residual <= MAX_RESIDUAL:
            level = min(amplitude, 1.0)
            return ((0.0, level), (length_ms, level)), ((0.0, frequency_hz), (length_ms, frequency_hz))
    return _windows(samples, rate_hz)


def _windows(samples: Samples, rate_hz: int) -> tuple[Curve, Curve]:
    """Return amplitude and frequency window by window, without points that their neighbours imply."""
    half, hop = max(round(WINDOW_MS / 2e3 * rate_hz), 2), max(round(HOP_MS / 1e3 * rate_hz), 1)
    power = np.concatenate([[0.0], np.cumsum(samples**2)])
    rises = np.flatnonzero((samples[:-1] < 0) & (samples[1:] >= 0))
    centres = np.unique(np.append(np.arange(0, len(samples), hop), len(samples)))
    firsts, lasts = np.maximum(centres - half, 0), np.minimum(centres + half, len(samples))
    level = np.minimum(np.sqrt(2 * (power[lasts] - power[firsts]) / (lasts - firsts)), 1.0)
    cycles = np.searchsorted(rises, lasts) - np.searchsorted(rises, firsts)
    hertz = np.where(cycles > 0, cycles / (lasts - firsts) * rate_hz, _frequency(samples, rate_hz))
    times_ms = centres / rate_hz * 1e3
    amplitude = list(zip(times_ms.tolist(), level.tolist(), strict=True))
    frequency_hz = list(zip(times_ms.tolist(), hertz.tolist(), strict=True))
    return _simplified(amplitude, TOLERANCE), _simplified(
        frequency_hz, TOLERANCE * max(float(hertz.max()), 1.0)
    )


def _frequency(samples: Samples, rate_hz: int) -> float:
    """Return the frequency by the zero crossings [Hz]; 0 if there are fewer than two."""
    at = np.flatnonzero((samples[:-1] < 0) != (samples[1:] < 0))
    if len(at) < 2:
        return 0.0
    crossings = at + samples[at] / (samples[at] - samples[at + 1])
    return float((len(at) - 1) / 2 / (crossings[-1] - crossings[0]) * rate_hz)


def _sine(samples: Samples, turns: float) -> tuple[float, float]:
    """Return the amplitude of the sine that fits best, and the residual as a share of it.

    Args:
        samples: Of one burst.
        turns: The frequency, in turns a sample.
    """
    angle = 2 * np.pi * turns * np.arange(len(samples))
    basis = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    weights = np.linalg.lstsq(basis, samples, rcond=None)[0]
    amplitude = float(np.hypot(*weights))
    residual = float(np.sqrt(2 * np.mean((samples - basis @ weights) ** 2)))
    return amplitude, residual / amplitude if amplitude else np.inf


def _simplified(curve: list[tuple[float, float]], tolerance: float) -> Curve:
    """Return a curve with as few of its points as a tolerance allows (Douglas-Peucker)."""
    kept = {0, len(curve) - 1}
    spans = [(0, len(curve) - 1)]
    points = np.array(curve)
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        part = points[first : last + 1]
        error = np.abs(part[:, 1] - np.interp(part[:, 0], part[[0, -1], 0], part[[0, -1], 1]))
        at = first + int(error.argmax())
        if error.max() > tolerance:
            kept.add(at)
            spans += [(first, at), (at, last)]
    return tuple(curve[at] for at in sorted(kept))


def _at(curve: Curve, times_ms: Samples) -> Samples:
    points = np.array(curve)
    values: Samples = np.interp(times_ms, points[:, 0], points[:, 1])
    return values


def _ramp(count: int) -> Samples:
    """Return the factors that fade a burst in and out within its own length."""
    length = max(round(min(RAMP_MS / 1e3 * RATE_HZ, RAMP_SHARE * count)), 1)
    rising = np.minimum((np.arange(count) + 0.5) / length, 1.0)
    factors: Samples = rising * rising[::-1]
    return factors


def _with_loop(content: bytes, count: int) -> bytes:
    """Return a WAV file with a chunk that loops all of it without end."""
    body = struct.pack("<9I", 0, 0, round(1e9 / RATE_HZ), 60, 0, 0, 0, 1, 0)
    body += struct.pack("<6I", 0, 0, 0, count - 1, 0, 0)
    whole = content + b"smpl" + struct.pack("<I", len(body)) + body
    return b"RIFF" + struct.pack("<I", len(whole) - 8) + whole[8:]


def _has_loop(content: bytes) -> bool:
    """Return whether a `smpl` chunk has a loop that is played without end."""
    at = 12
    while at + 8 <= len(content):
        name, size = content[at : at + 4], struct.unpack("<I", content[at + 4 : at + 8])[0]
        if name == b"smpl" and size >= 60 and at + 68 <= len(content):
            loops, plays = struct.unpack("<I", content[at + 36 : at + 40])[0], content[at + 64 : at + 68]
            return bool(loops) and plays == bytes(4)
        at += 8 + size + size % 2
    return False
