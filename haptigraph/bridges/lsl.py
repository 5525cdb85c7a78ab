"""Stream states, commands and measures over Lab Streaming Layer, for instance next to EEG and eye tracking.

Samples are stamped on LSL's clock: states and measures when the image was taken, commands when they were
passed to the device.
"""

import math
import socket

from haptigraph.bridges.bridge import RunContext
from haptigraph.clock import offset_ns
from haptigraph.errors import BadInput, MissingExtra
from haptigraph.messages import Capture, Step

try:
    import pylsl
except ImportError:
    raise MissingExtra("bridge lsl", "lsl") from None

__all__ = ["LslLink"]

UNITS = {"mm": "millimeters", "deg": "degrees"}  # as in LSL's metadata


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
        self._measures = run.measures
        self._clock = run.clock
        self._state = pylsl.StreamOutlet(_info("state", "Markers", run, ("state",)))
        self._command = pylsl.StreamOutlet(_info("command", "Markers", run, ("pattern",)))
        self._numbers = pylsl.StreamOutlet(_info("measures", "Misc", run, run.measures))
        self._last_state = ""
        self._last_command: tuple[str, int] | None = None

    def send_step(self, capture: Capture, step: Step) -> None:
        """Push the measures of one step, and a marker for every change."""
        image_s = self._lsl_s(step.stamp_ns)
        measures = step.graph.measures
        self._numbers.push_sample([measures.get(name, math.nan) for name in self._measures], image_s)
        if step.conclusion.state != self._last_state:
            self._last_state = step.conclusion.state
            self._state.push_sample([self._last_state], image_s)
        command = step.command.pattern.name, step.command.since_ns
        if command != self._last_command:
            self._last_command = command
            commanded_ns = step.timing.commanded_ns if step.timing else step.stamp_ns
            self._command.push_sample([command[0]], self._lsl_s(commanded_ns))

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
        for name in ("_state", "_command", "_numbers"):
            vars(self).pop(name, None)  # pylsl closes outlets that are not referenced


def _lsl_ns() -> int:
    return round(float(pylsl.local_clock()) * 1e9)


def _info(name: str, kind: str, run: RunContext, channels: tuple[str, ...]) -> pylsl.StreamInfo:
    """Describe a stream, with an irregular rate, because images may be missing and stamps are exact."""
    content = pylsl.cf_string if kind == "Markers" else pylsl.cf_double64
    source_id = f"haptigraph.{name}@{socket.gethostname()}"
    info = pylsl.StreamInfo(
        f"haptigraph.{name}", kind, len(channels), pylsl.IRREGULAR_RATE, content, source_id
    )
    description = info.desc()
    for key in ("version", "source", "procedure_sha256", "registration_sha256", "participant", "trial"):
        description.append_child_value(key, getattr(run.info, key))
    description.append_child_value("image_rate_hz", f"{run.info.rate_hz:g}")
    channel_list = description.append_child("channels")
    for channel in channels:
        unit = UNITS.get(channel.rpartition("_")[2], "")
        entry = channel_list.append_child("channel").append_child_value("label", channel)
        entry.append_child_value("unit", unit).append_child_value("type", kind)
    return info
