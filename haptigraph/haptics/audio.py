"""Drive a voice coil through an amplifier on the sound card, or write its signal to a WAV file.

The sound card requests samples from a thread of its own; the file is written up to the newest stamp. If the
run dies, the sound card is silent because it receives no more samples.
"""

import wave
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptigraph.errors import BadInput, DeviceError, MissingExtra
from haptigraph.haptics.tone import RATE_HZ, Tone
from haptigraph.messages import Capabilities

__all__ = ["AudioDevice", "SoundCard", "SoundFile"]

HOLDS_MS = 150.0
MAX_CHANNELS = 64


class AudioDevice:
    """Play on the sound card, or into a file.

    Args:
        argument: Path of a new .wav file, or the name or number of a sound card's output; the system default
            if empty. ?channels=3,4 names the channels that play, counted from 1; 1 and 2 if not given.

    Raises:
        BadInput: If the file or the sound card cannot be used.
        MissingExtra: If there is no file and sounddevice is not installed.
    """

    capabilities = Capabilities(
        amplitude_levels=32767,
        frequency_range_hz=(20.0, 1000.0),
        shortest_on_ms=10.0,
        holds_ms=HOLDS_MS,
        limitations="Ramps of 5 ms prevent clicks; a pattern without frequency plays at 160 Hz.",
    )

    def __init__(self, argument: str = "") -> None:
        is_file = argument.lower().endswith(".wav")
        self._player: SoundFile | SoundCard = SoundFile(argument) if is_file else SoundCard(argument)

    @staticmethod
    def found() -> dict[str, str]:
        """Return the outputs of the sound cards: the device argument and the name of each."""
        outputs = [card for card in _sounddevice().query_devices() if card["max_output_channels"]]
        return {f"audio:{card['index']}": card["name"] for card in outputs}

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Play from now on."""
        self._player.set(amplitude, frequency_hz, stamp_ns)

    def close(self) -> None:
        """Stop the sound and release the file or sound card."""
        self._player.close()


class SoundCard:
    """Provide samples to a sound card on request.

    Args:
        argument: Name or number of the output, the system default if empty, and ?channels=N,N.
    """

    def __init__(self, argument: str) -> None:
        output, self._channels = _output_and_channels(argument)
        self._tone = Tone(HOLDS_MS)
        sounddevice = _sounddevice()
        self._error: type[Exception] = sounddevice.PortAudioError
        try:
            self._stream = sounddevice.OutputStream(
                device=int(output) if output.isdecimal() else output or None,
                samplerate=RATE_HZ,
                channels=max(self._channels) + 1,
                dtype="float32",
                latency="low",
                callback=self.fill,
            )
            self._stream.start()
        except (self._error, ValueError) as error:
            raise BadInput(
                f"cannot be opened ({error})", f"audio:{argument}" if argument else "audio"
            ) from None

    def fill(self, samples: NDArray[np.float32], count: int, *_: Any) -> None:
        """Fill the sound card's next buffer, (count, channels)."""
        samples[:] = 0
        samples[:, self._channels] = self._tone.samples(count)[:, None]

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Play from the next buffer on."""
        self._tone.set(amplitude, frequency_hz)
        if not self._stream.active:
            try:
                self._stream.start()
            except self._error as error:
                raise DeviceError(f"the sound card is lost ({error})") from None

    def close(self) -> None:
        """Stop playing."""
        with suppress(self._error):
            self._stream.close()


class SoundFile:
    """Write what a sound card would play; the first stamp is the beginning of the file.

    Args:
        path: The new file; never overwrites one.
    """

    def __init__(self, path: str) -> None:
        self._path, self._tone = Path(path), Tone(HOLDS_MS)
        self._start_ns: int | None = None
        self._written = 0
        self._wave: wave.Wave_write | None = None
        try:
            self._file = self._path.open("xb", buffering=0)
        except FileExistsError:
            raise BadInput("exists already; choose the name of a new file", path) from None
        except OSError as error:
            raise BadInput(f"cannot be written ({error.strerror})", path) from None

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Write the sound up to now; it remains readable if the run is killed."""
        if self._wave is None or self._start_ns is None:
            self._wave, self._start_ns = wave.Wave_write(self._file), stamp_ns
            self._wave.setparams((1, 2, RATE_HZ, 0, "NONE", "not compressed"))
        self._write_until(self._wave, round((stamp_ns - self._start_ns) * RATE_HZ / 1e9))
        self._tone.set(amplitude, frequency_hz)

    def close(self) -> None:
        """End with a ramp to silence; delete the file if nothing was played."""
        if self._file.closed:
            return
        try:
            if self._wave is not None:
                self._tone.set(0.0, 0.0)
                self._write_until(self._wave, self._written + RATE_HZ // 100)
        finally:
            with suppress(OSError):  # a full disk
                if self._wave is not None:
                    self._wave.close()
            with suppress(OSError):
                self._file.close()
            if self._wave is None:
                self._path.unlink()

    def _write_until(self, sound: wave.Wave_write, end: int) -> None:
        """Write up to a sample, one second at a time."""
        while self._written < end:
            count = min(end - self._written, RATE_HZ)
            samples = np.round(self._tone.samples(count) * 32767).astype("<i2")
            try:
                sound.writeframes(samples.tobytes())
            except OSError as error:
                raise DeviceError(f"{self._path} cannot be written ({error.strerror})") from None
            self._written += count


def _output_and_channels(argument: str) -> tuple[str, list[int]]:
    """Return the output and the indices of its channels that play."""
    output, asks, query = argument.rpartition("?")
    if not asks:
        return argument, [0, 1]
    key, _, text = query.partition("=")
    numbers = [int(number) for number in text.split(",") if number.isdecimal()]
    is_valid = len(numbers) == len(text.split(",")) and all(1 <= number <= MAX_CHANNELS for number in numbers)
    if key != "channels" or not is_valid:
        raise BadInput(
            f"found ?{query}; valid: the channels that play, 1 to {MAX_CHANNELS}, as in ?channels=3,4",
            f"audio:{argument}",
        )
    return output, [number - 1 for number in numbers]


def _sounddevice() -> Any:
    try:
        import sounddevice  # noqa: PLC0415 - an extra
    except ModuleNotFoundError:
        raise MissingExtra("device audio", "audio") from None
    except OSError:
        problem = "the PortAudio library is missing; on Debian: apt-get install libportaudio2"
        raise BadInput(problem, "audio") from None
    return sounddevice
