"""Images from a recording: the exact bytes that perception consumed during the run."""

from pathlib import Path

import msgspec
from msgspec.structs import replace

from haptigraph.errors import EndOfSource
from haptigraph.messages import Capture, Fault
from haptigraph.projection import DepthCamera
from haptigraph.recording.reader import RunReader
from haptigraph.sources.timing import moved_in_time
from haptigraph.stages import Source

__all__ = ["RecordingSource"]


class RecordingSource(Source):
    """Play the captures of a recording.

    Args:
        path: The MCAP file.

    Raises:
        BadInput: If it is not a recording.
    """

    is_live = False

    def __init__(self, path: str | Path) -> None:
        self._reader = RunReader(path)
        self.rate_hz = self._reader.info.rate_hz
        self.registration = self._reader.info.registration
        self.robot_setup = self._reader.info.robot_setup or None
        camera = self._reader.info.depth_camera
        self.depth_camera = msgspec.json.decode(camera, type=DepthCamera) if camera else None
        self._records = self._reader.records()
        self._differing_images = 0
        self._first_ns: int | None = None

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next capture."""
        capture, _ = next(self._records, (None, None))
        if capture is None:
            raise EndOfSource
        if self._first_ns is None:
            self._first_ns = capture.stamp_ns
        faults = capture.faults
        if self._reader.differing_images > self._differing_images:
            self._differing_images = self._reader.differing_images
            decoder = self._reader.info.decoder
            faults = (*faults, Fault("source", f"image has other pixels than when {decoder} decoded it"))
        return replace(moved_in_time(capture, -self._first_ns), faults=faults)

    def close(self) -> None:
        """Close the file."""
        self._records.close()
