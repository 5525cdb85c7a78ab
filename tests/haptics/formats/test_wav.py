"""WAV: sounds of other programs, loops, and what is no sound."""

import io
import wave

import numpy as np
import pytest

from haptigraph.errors import BadInput
from haptigraph.haptics.formats import wav
from haptigraph.haptics.formats.curve import value_after
from haptigraph.haptics.formats.envelope import Envelope, enveloped
from haptigraph.haptics.formats.fitting import fit
from haptigraph.messages import Pattern

RATE_HZ = 8000


def sound(samples, width=2, channels=1, rate_hz=RATE_HZ):
    """A WAV file with samples in [-1, 1], (count,), in every channel."""
    whole = np.repeat(np.asarray(samples)[:, None], channels, axis=1)
    scaled = np.round(whole * (2 ** (8 * width - 1) - 1)).astype("<i8")
    raw = (scaled + 128 * (width == 1)).astype("<i8").tobytes()
    kept = b"".join(raw[at : at + width] for at in range(0, len(raw), 8))
    file = io.BytesIO()
    with wave.open(file, "wb") as written:
        written.setparams((channels, width, rate_hz, 0, "NONE", "not compressed"))
        written.writeframes(kept)
    return file.getvalue()


def sine(frequency_hz, length_s, rate_hz=RATE_HZ):
    return np.sin(2 * np.pi * frequency_hz * np.arange(round(length_s * rate_hz)) / rate_hz)


@pytest.mark.parametrize("width", [1, 2, 3, 4])
@pytest.mark.parametrize("channels", [1, 2])
def test_a_burst_of_another_program_is_read(width, channels):
    silence = np.zeros(800)
    found = wav.read(
        sound(np.concatenate([silence, 0.5 * sine(120, 0.2), silence]), width, channels), "a.wav"
    )
    assert found.duration_ms == 400
    assert value_after(found.amplitude, 200) == pytest.approx(0.5, rel=0.01)
    assert value_after(found.frequency_hz, 200) == pytest.approx(120, rel=0.01)
    assert (value_after(found.amplitude, 50), value_after(found.amplitude, 350)) == (0, 0)
    assert fit(found, "p").pattern.on_ms == pytest.approx(200, abs=2)
    assert found.notes == (("first of 2 channels",) if channels == 2 else ())


def test_a_fade_is_followed():
    fading = np.linspace(1, 0, 8000) * sine(200, 1.0)
    found = wav.read(sound(fading), "a.wav")
    for time_ms in (100, 300, 500, 800):
        assert value_after(found.amplitude, time_ms) == pytest.approx(1 - time_ms / 1000, abs=0.03)
        assert value_after(found.frequency_hz, time_ms) == pytest.approx(200, abs=45)  # whole cycles of 25 ms


def test_silence_is_read_as_silence():
    assert wav.read(sound(np.zeros(80)), "a.wav").peak == 0


def test_bursts_begin_and_end_in_silence_without_a_click():
    content = wav.write(enveloped(Pattern("p", "bursts", 1.0, 90, 100, 100, 2), 0), "p")
    with wave.open(io.BytesIO(content)) as written:
        samples = np.frombuffer(written.readframes(written.getnframes()), "<i2") / 32767
    assert len(samples) == 14_400
    assert np.abs(np.diff(samples, prepend=0, append=0)).max() < 2 * np.pi * 90 / 48_000 * 1.2
    assert np.abs(samples).max() == pytest.approx(1.0, abs=1e-3)


def test_a_loop_is_in_a_chunk_that_other_programs_skip():
    content = wav.write(Envelope(((0.0, 0.5), (100.0, 0.5)), repeats=True), "p")
    with wave.open(io.BytesIO(content)) as written:
        assert written.getnframes() == 4800
    assert int.from_bytes(content[4:8], "little") == len(content) - 8
    assert wav.read(content, "a.wav").repeats


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "not a WAV file"),
        (b"RIFF", "not a WAV file"),
        (b"RIFF\x04\x00\x00\x00WAVE", "not a WAV file"),
        (sound(np.zeros(10))[:16] + b"\x11" + sound(np.zeros(10))[17:], "not a WAV file"),  # a chunk's size
        (sound(np.zeros(0)), "lasts 0 s"),
        (sound(np.zeros(10), rate_hz=100), "100 samples/s; valid: 1000 to 192000"),
        (sound(np.zeros(400_000), 1, rate_hz=2000), "lasts 200 s; valid: up to 180 s"),
    ],
)
def test_what_is_no_sound_is_refused(content, sentence):
    with pytest.raises(BadInput, match=r"a\.wav") as error:
        wav.read(content, "a.wav")
    assert sentence in str(error.value)


def test_floating_point_samples_are_refused_with_what_to_do():
    content = bytearray(sound(np.zeros(10)))
    content[20] = 3  # the format tag
    with pytest.raises(BadInput, match="save it as 16-bit PCM"):
        wav.read(bytes(content), "a.wav")
