"""The streams of Lab Streaming Layer (LSL) that a run becomes, live or as a file: format and samples."""

import math
from collections.abc import Iterator

from msgspec import Struct

from haptigraph.messages import Step
from haptigraph.recording.schema import RunInfo

__all__ = ["IRREGULAR_RATE_HZ", "LslSample", "LslSamples", "LslStream", "lsl_streams"]

IRREGULAR_RATE_HZ = 0.0
"""The nominal rate of all streams: images may be missing, and stamps are exact."""
UNITS = {"mm": "millimeters", "deg": "degrees"}  # as in LSL's metadata
DESCRIBED = ("version", "source", "procedure_sha256", "registration_sha256", "participant", "trial")


class LslStream(Struct, frozen=True):
    """One stream."""

    name: str
    type: str
    """LSL's content type: "Markers" (a string) or "Misc" (64-bit floats)."""
    channels: tuple[str, ...]
    description: dict[str, str]

    @property
    def is_text(self) -> bool:
        """Whether its values are strings."""
        return self.type == "Markers"

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of each channel."""
        return tuple(UNITS.get(channel.rpartition("_")[2], "") for channel in self.channels)


class LslSample(Struct, frozen=True):
    """A sample of one stream, stamped on the run's clock."""

    stream: str
    values: tuple[str, ...] | tuple[float, ...]
    stamp_ns: int


def lsl_streams(info: RunInfo, measures: tuple[str, ...]) -> dict[str, LslStream]:
    """Return the streams of a run by what they contain: state, command, measures.

    Args:
        info: The run.
        measures: Names of the measures in its graphs.
    """
    described = {key: str(getattr(info, key)) for key in DESCRIBED}
    described["image_rate_hz"] = f"{info.rate_hz:g}"
    kinds = {
        "state": ("Markers", ("state",)),
        "command": ("Markers", ("pattern",)),
        "measures": ("Misc", measures),
    }
    return {
        key: LslStream(f"haptigraph.{key}", kind, channels, described)
        for key, (kind, channels) in kinds.items()
    }


class LslSamples:
    """Turn steps into samples: measures of every step, state and command at every change.

    Args:
        measures: Names of the measures, in the order of the channels.
    """

    def __init__(self, measures: tuple[str, ...]) -> None:
        self._measures = measures
        self._last_state = ""
        self._last_command: tuple[str, int] | None = None

    def of_step(self, step: Step) -> Iterator[LslSample]:
        """Yield the samples: of the image's time, and of the time when the command went to the device."""
        measures = step.graph.measures
        values = tuple(measures.get(name, math.nan) for name in self._measures)
        yield LslSample("measures", values, step.stamp_ns)
        if step.conclusion.state != self._last_state:
            self._last_state = step.conclusion.state
            yield LslSample("state", (self._last_state,), step.stamp_ns)
        command = step.command.pattern.name, step.command.since_ns
        if command != self._last_command:
            self._last_command = command
            commanded_ns = step.timing.commanded_ns if step.timing else step.stamp_ns
            yield LslSample("command", (command[0],), commanded_ns)
