"""Serve a run live to Foxglove over its websocket, with the channels and schemas of a recording."""

import msgspec
from msgspec.structs import replace

from haptigraph.bridges.bridge import RunContext
from haptigraph.bridges.opening import parse_address
from haptigraph.errors import BadInput, MissingExtra
from haptigraph.messages import Capture, Step
from haptigraph.recording.codec import encode_jpeg
from haptigraph.recording.entries import entries
from haptigraph.recording.foxglove import encode_message
from haptigraph.recording.schema import TOPICS, mcap_schema

try:
    import foxglove
except ImportError:
    raise MissingExtra("bridge foxglove", "foxglove") from None

__all__ = ["FoxgloveLink"]

PORT = 8765
BACKLOG = 64
"""Messages queued for a slow viewer before it misses the oldest."""
JPEG_QUALITY = 80


class FoxgloveLink:
    """A server for any number of Foxglove viewers.

    Args:
        argument: PORT or HOST:PORT; empty: 8765 on this machine.
        run: The run to publish.

    Raises:
        BadInput: If it cannot listen at this address.
        MissingExtra: If foxglove-sdk is not installed.
    """

    def __init__(self, argument: str, run: RunContext) -> None:
        self._image, self._utc_offset_ns = run.image, run.info.utc_offset_ns
        host, port = parse_address(argument, "foxglove", PORT)
        self._context = foxglove.Context()  # the library drops a context that is not referenced
        try:
            self._server = foxglove.start_server(
                name=f"haptigraph: {run.info.source}",
                host=host,
                port=port,
                context=self._context,
                message_backlog_size=BACKLOG,
            )
        except Exception as error:  # the library raises types of its own
            raise BadInput(f"bridge foxglove cannot listen at {host}:{port} ({error})") from None
        self.port = self._server.port
        self._channels = {
            topic.name: foxglove.Channel(
                topic.name,
                message_encoding="json",
                schema=foxglove.Schema(
                    name=topic.schema,
                    encoding="jsonschema",
                    data=msgspec.json.encode(mcap_schema(topic, run.measures)),
                ),
                context=self._context,
            )
            for topic in TOPICS
        }
        self._open = True

    def send_step(self, capture: Capture, step: Step) -> None:
        """Send one step to all viewers; raw images as JPEG, for speed."""
        if not any(channel.has_sinks() for channel in self._channels.values()):
            return
        if capture.image is not None and capture.encoded is None:
            capture = replace(capture, encoded=encode_jpeg(capture.image, JPEG_QUALITY))
        utc_ns = step.stamp_ns + self._utc_offset_ns
        for topic, message in entries(capture, step, image=self._image, utc_offset_ns=self._utc_offset_ns):
            self._channels[topic].log(encode_message(message), log_time=utc_ns)

    def send_output(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Do nothing: a recording has no channel for it."""

    def take_problems(self) -> tuple[str, ...]:
        """Return no problems: viewers may disconnect at any time."""
        return ()

    def close(self) -> None:
        """Stop the server."""
        if self._open:
            self._open = False
            self._server.stop()
