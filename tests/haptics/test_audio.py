"""The signal for a voice coil: in the buffers that a sound card requests, and in the file."""

import sys
import wave

import numpy as np
import pytest
from helpers import MS
from hypothesis import example, given
from hypothesis import strategies as st

from haptigraph.errors import BadInput, DeviceError, MissingExtra
from haptigraph.haptics.audio import AudioDevice, SoundCard
from haptigraph.haptics.tone import RATE_HZ, Tone


def envelope(samples, window_s=0.002):
    count = round(window_s * RATE_HZ)
    return np.abs(samples[: len(samples) // count * count]).reshape(-1, count).max(axis=1)


def read_wav(path):
    with wave.open(str(path)) as file:
        assert (file.getnchannels(), file.getsampwidth(), file.getframerate()) == (1, 2, RATE_HZ)
        return np.frombuffer(file.readframes(file.getnframes()), "<i2") / 32767


def test_the_sine_has_the_frequency_and_amplitude_that_are_set():
    tone = Tone(holds_ms=10_000)
    tone.set(0.5, 160.0)
    samples = tone.samples(RATE_HZ)
    spectrum = np.abs(np.fft.rfft(samples))
    assert np.argmax(spectrum) == 160  # Hz: the samples last one second
    assert np.abs(samples).max() == pytest.approx(0.5, abs=1e-3)


def test_without_a_frequency_the_default_is_played():
    tone = Tone(holds_ms=1000)
    tone.set(0.5, 0.0)
    assert np.argmax(np.abs(np.fft.rfft(tone.samples(RATE_HZ // 10)))) == 16  # bins of 10 Hz


def test_silence_is_reached_within_5_ms_without_a_click():
    tone = Tone(holds_ms=1000)
    tone.set(1.0, 250.0)
    before = tone.samples(RATE_HZ // 10)
    tone.set(0.0, 0.0)
    after = tone.samples(RATE_HZ // 10)
    assert np.all(after[round(0.005 * RATE_HZ) :] == 0)
    steepest = 2 * np.pi * 250 / RATE_HZ + 1 / (0.005 * RATE_HZ)
    assert np.abs(np.diff(np.concatenate([before, after]))).max() <= steepest * 1.01


def test_a_tone_that_is_not_set_again_ends_by_itself():
    tone = Tone(holds_ms=150)
    tone.set(1.0, 160.0)
    samples = tone.samples(RATE_HZ)
    assert np.all(samples[round(0.155 * RATE_HZ) :] == 0)
    assert envelope(samples)[60:74].max() > 0.9


@given(
    settings=st.lists(
        st.tuples(st.floats(0, 1), st.floats(20, 1000), st.integers(1, 10_000)), min_size=1, max_size=6
    ),
    block=st.integers(97, 3000),
)
@example(settings=[(1.0, 100.0, 300), (0.0, 100.0, 240), (1.0, 250.0, 400)], block=8)
def test_the_sound_does_not_depend_on_the_buffer_size_and_never_clicks(settings, block):
    whole, parts = Tone(150), Tone(150)
    one, many = [], []
    for amplitude, frequency_hz, count in settings:
        whole.set(amplitude, frequency_hz)
        parts.set(amplitude, frequency_hz)
        one.append(whole.samples(count))
        many += [parts.samples(min(block, count - start)) for start in range(0, count, block)]
    one, many = np.concatenate(one), np.concatenate(many)
    assert np.allclose(one, many, atol=1e-4)
    assert np.abs(one).max() <= 1
    steepest = 2 * np.pi * 1000 / RATE_HZ + 1 / (0.005 * RATE_HZ)
    assert np.abs(np.diff(one)).max(initial=0) <= steepest * 1.01


class FakePort:
    """Replaces PortAudio, because the machine may have no sound card; requests buffers on `request`."""

    PortAudioError = type("PortAudioError", (Exception,), {})

    def __init__(self):
        self.opened, self.active, self.lost = None, False, False

    def OutputStream(self, **options):
        if options["device"] == "nowhere":
            raise ValueError("No output device matching 'nowhere'")
        self.opened = options
        return self

    def start(self):
        if self.lost:
            raise self.PortAudioError("Device unavailable")
        self.active = True

    def close(self):
        self.active = False

    def request(self, count):
        samples = np.full((count, self.opened["channels"]), np.nan, np.float32)
        self.opened["callback"](samples, count, None, None)
        return samples


@pytest.fixture
def port(monkeypatch):
    port = FakePort()
    monkeypatch.setitem(sys.modules, "sounddevice", port)
    return port


def test_the_sound_card_receives_the_tone_on_every_channel(port):
    device = AudioDevice("")
    assert isinstance(device._player, SoundCard)
    assert port.active
    device.set(0.0, 0.0, 0)
    assert np.all(port.request(512) == 0)
    device.set(1.0, 160.0, 1)
    samples = port.request(4800)
    assert samples.max() == pytest.approx(1.0, abs=1e-3)
    assert np.array_equal(samples[:, 0], samples[:, 1])
    device.set(0.0, 0.0, 2)
    assert np.all(port.request(512)[240:] == 0)
    device.close()
    device.close()
    assert not port.active


@pytest.mark.parametrize(
    ("argument", "output", "count", "playing"),
    [
        ("2?channels=3,4", 2, 4, [2, 3]),
        ("DualSense: USB Audio?channels=4", "DualSense: USB Audio", 4, [3]),
        ("?channels=1", None, 1, [0]),
    ],
)
def test_only_the_channels_that_are_named_play(port, argument, output, count, playing):
    device = AudioDevice(argument)
    assert port.opened["device"] == output
    assert port.opened["channels"] == count
    device.set(1.0, 160.0, 0)
    samples = port.request(4800)
    assert [channel for channel in range(count) if samples[:, channel].any()] == playing
    assert not np.isnan(samples).any()
    device.close()


@pytest.mark.parametrize(
    "query", ["channels=0", "channels=", "channels=3,", "channels=x", "chanels=3", "channels=65"]
)
def test_invalid_channels_are_refused(port, query):
    with pytest.raises(BadInput, match=r"audio:2\?chan.*: found \?chan.*as in \?channels=3,4"):
        AudioDevice(f"2?{query}")


def test_a_stopped_sound_card_is_restarted_or_reported(port):
    device = AudioDevice("2")
    assert port.opened["device"] == 2
    port.active, port.lost = False, True
    with pytest.raises(DeviceError, match="sound card is lost"):
        device.set(1.0, 160.0, 0)
    port.lost = False
    device.set(1.0, 160.0, 0)
    assert port.active


def test_a_missing_sound_card_is_reported(port):
    with pytest.raises(BadInput, match="audio:nowhere: cannot be opened"):
        AudioDevice("nowhere")


def test_portaudio_reports_a_machine_without_a_sound_card():
    try:
        sounddevice = pytest.importorskip("sounddevice", exc_type=ImportError)
    except OSError:
        pytest.skip("needs PortAudio: apt-get install libportaudio2")
    if sounddevice.query_devices():
        pytest.skip("the machine has a sound card; the test must not play on it")
    with pytest.raises(BadInput, match="audio: cannot be opened"):
        AudioDevice("")


def test_the_error_without_the_extra_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "sounddevice", None)
    with pytest.raises(MissingExtra, match=r"pip install 'haptigraph\[audio\]'"):
        AudioDevice("")


def test_a_file_contains_every_amplitude_at_its_time(tmp_path):
    path = tmp_path / "touch.wav"
    device = AudioDevice(str(path))
    for ms, amplitude in [(0, 0.0), (100, 1.0), (175, 1.0), (180, 0.0), (260, 0.3), (300, 0.0)]:
        device.set(amplitude, 160.0, 7_000_000_000 + ms * MS)
    readable = read_wav(path)  # before it is closed, as after a kill
    assert len(readable) == round(0.3 * RATE_HZ)
    device.close()
    device.close()
    loud = envelope(read_wav(path), 0.01)
    assert np.all(loud[:10] == 0)
    assert np.all(loud[11:18] > 0.95)
    assert np.all(loud[19:26] == 0)
    assert np.all(np.abs(loud[27:30] - 0.3) < 0.02)
    assert np.all(read_wav(path)[-200:] == 0)


def test_an_existing_file_is_not_overwritten_and_an_unused_one_is_deleted(tmp_path):
    path = tmp_path / "touch.wav"
    AudioDevice(str(path)).close()
    assert not path.exists()
    path.write_text("precious")
    with pytest.raises(BadInput, match="exists already; choose the name of a new file"):
        AudioDevice(str(path))
    assert path.read_text() == "precious"
    with pytest.raises(BadInput, match="cannot be written"):
        AudioDevice(str(tmp_path / "no" / "x.wav"))


def test_a_full_disk_is_reported(tmp_path):
    path = tmp_path / "full.wav"
    device = AudioDevice(str(path))
    device._player._file.close()
    device._player._file = open("/dev/full", "wb", buffering=0)  # noqa: SIM115
    with pytest.raises(DeviceError, match=r"full\.wav cannot be written \(No space left on device\)"):
        for ms in (0, 10):
            device.set(1.0, 160.0, ms * MS)
    with pytest.raises(DeviceError):
        device.close()
