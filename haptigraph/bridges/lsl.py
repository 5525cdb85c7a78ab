"""Stream states, commands and measures over Lab Streaming Layer, for instance next to EEG and eye tracking.

Samples are stamped on LSL's clock: states and measures when the image was taken, commands when they were
passed to the device.
"""

import socket

from haptigraph.analysis.exporting.lsl_streams import IRREGULAR_RATE_HZ, LslSamples, LslStream, lsl_streams
from haptigraph.bridges.bridge import RunContext
from haptigraph.clock import offset_ns
from haptigraph.errors import BadInput, MissingExtra
from haptigraph.messages import Capture, Step

try:
    import pylsl
except ImportError:
    raise MissingExtra("bridge lsl", "lsl") from None

__all__ = ["LslLink"]


class LslLink:
    """Three outlets: haptigraph.state and haptigraph.command (markers, at every change), haptigraph.measures.

    Args:
        argument: Must be empty.
        run: The run to publish.

    Raises:
        BadInput: If an argument is given.
        MissingExtra: If pylsl is not installed.
    """

    def __init__(self, argument: str, run: RunContext) -> None:
        if argument:
            raise BadInput(f"bridge lsl takes no argument, found {argument!r}; remove it")
        self._clock = run.clock
        self._samples = LslSamples(run.measures)
        streams = lsl_streams(run.info, run.measures)
        self._outlets = {key: pylsl.StreamOutlet(_info(stream)) for key, stream in streams.items()}

    def send_step(self, capture: Capture, step: Step) -> None:
        """Push the measures of one step, and a marker for every change."""
        for sample in self._samples.of_step(step):
            self._outlets[sample.stream].push_sample(list(sample.values), self._lsl_s(sample.stamp_ns))

    def _lsl_s(self, stamp_ns: int) -> float:
        """Convert a stamp of the run to LSL's clock; the offset is measured every time, because it drifts."""
        return (stamp_ns + offset_ns(_lsl_ns, self._clock)) / 1e9

    def send_output(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Do nothing: the markers are of commands."""

    def take_problems(self) -> tuple[str, ...]:
        """Return no problems: an outlet does not know its listeners."""
        return ()

    def close(self) -> None:
        """Close the outlets."""
        self._outlets.clear()  # pylsl closes outlets that are not referenced


def _lsl_ns() -> int:
    return round(float(pylsl.local_clock()) * 1e9)


def _info(stream: LslStream) -> pylsl.StreamInfo:
    """Describe a stream to LSL."""
    content = pylsl.cf_string if stream.is_text else pylsl.cf_double64
    source_id = f"{stream.name}@{socket.gethostname()}"
    count = len(stream.channels)
    info = pylsl.StreamInfo(stream.name, stream.type, count, IRREGULAR_RATE_HZ, content, source_id)
    description = info.desc()
    for key, value in stream.description.items():
        description.append_child_value(key, value)
    channel_list = description.append_child("channels")
    for channel, unit in zip(stream.channels, stream.units, strict=True):
        entry = channel_list.append_child("channel").append_child_value("label", channel)
        entry.append_child_value("unit", unit).append_child_value("type", stream.type)
    return info
