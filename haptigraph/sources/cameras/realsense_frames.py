"""Colour frames of the RealSense SDK, each with the depths of the same pixels if they are asked for.

The SDK pairs both streams by their time stamps and maps depth to the pixels of colour.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from haptigraph.errors import BadInput
from haptigraph.messages import DepthImage
from haptigraph.projection import DepthCamera
from haptigraph.sources.cameras.realsense_sdk import sdk

__all__ = ["ColourFrames", "depth_of"]

QUEUE_SIZE = 2  # short, so that the newest image does not wait behind older ones
MAX_ALONE = 30  # depth frames in a row without colour: then colour has stopped
NEAR_WIDTH_PX = 848
"""Of depth images: D400 cameras search 128 px of disparity, so wider ones see nothing as near as an eye."""
MM_PER_M = 1000.0


class ColourFrames:
    """The frames of a device.

    Args:
        name: Of the source, for errors.
        device: The device.
        colour: The sensor that streams colour, and the stream.
        with_depth: Whether depth is streamed, too.

    Raises:
        BadInput: If the device has no depth at that rate, or does not say how its depth is measured.
    """

    def __init__(self, name: str, device: Any, colour: tuple[Any, Any], *, with_depth: bool) -> None:
        rs, (sensor, profile) = sdk(), colour
        self._sensors = [(sensor, [profile])]
        self.depth_camera: DepthCamera | None = None
        self._align: Any = None
        self._queue: Any = rs.syncer(QUEUE_SIZE) if with_depth else rs.frame_queue(QUEUE_SIZE)
        if with_depth:
            depth_sensor, depth = _depth_stream(name, device, profile)
            self.depth_camera = _camera_of(name, depth_sensor, depth, profile)
            self._align = rs.align(rs.stream.color)
            if _is_same(sensor, depth_sensor):
                self._sensors = [(sensor, [profile, depth])]
            else:
                self._sensors.append((depth_sensor, [depth]))

    def start(self) -> None:
        """Open the sensors and start streaming."""
        for sensor, profiles in self._sensors:
            sensor.open(profiles if len(profiles) > 1 else profiles[0])
            sensor.start(self._queue)

    def wait(self, timeout_ms: int) -> tuple[Any, DepthImage | None] | None:
        """Return the next colour frame and its depths; None after the timeout."""
        if self._align is None:
            has_frame, frame = self._queue.try_wait_for_frame(timeout_ms)
            return (frame, None) if has_frame else None
        for _ in range(MAX_ALONE):
            has_frames, frames = self._queue.try_wait_for_frames(timeout_ms)
            colour = frames.get_color_frame() if has_frames else None
            if colour:
                aligned = self._align.process(frames) if frames.get_depth_frame() else frames
                return colour, depth_of(aligned.get_depth_frame())
            if not has_frames:
                break
        return None

    def close(self) -> None:
        """Stop streaming, as far as it ever began."""
        for sensor, _ in self._sensors:
            for part in ("stop", "close"):
                try:
                    getattr(sensor, part)()
                except RuntimeError:  # it never started, or is disconnected
                    continue


def depth_of(frame: Any) -> DepthImage | None:
    """Return a depth frame's values; None without a frame."""
    if not frame:
        return None
    return DepthImage(np.array(frame.get_data(), np.uint16), MM_PER_M * frame.get_units())


def _depth_stream(name: str, device: Any, colour: Any) -> tuple[Any, Any]:
    """Return the sensor that streams depth at the rate of colour, and its stream of the usual size."""
    rs = sdk()
    found: Sequence[tuple[Any, Any]] = [
        (sensor, profile.as_video_stream_profile())
        for sensor in device.query_sensors()
        for profile in sensor.get_stream_profiles()
        if profile.stream_type() == rs.stream.depth and profile.fps() == colour.fps()
    ]
    if not found:
        raise BadInput(f"{name} has no depth images at {colour.fps()}/s; set source.depth=false")
    return min(found, key=lambda pair: abs(pair[1].width() - min(NEAR_WIDTH_PX, colour.width())))


def _camera_of(name: str, sensor: Any, depth: Any, colour: Any) -> DepthCamera:
    """Return how depth is measured; its pixels are those of colour."""
    rs = sdk()
    if not sensor.supports(rs.option.stereo_baseline):
        raise BadInput(f"{name} does not state its stereo baseline; set source.depth=false")
    baseline_mm = sensor.get_option(rs.option.stereo_baseline)
    own, image = depth.get_intrinsics(), colour.get_intrinsics()
    focal_px = (image.fx + image.fy) / 2
    if min(focal_px, own.fx, baseline_mm) <= 0:
        raise BadInput(f"{name} states no focal length and baseline of its depth; set source.depth=false")
    return DepthCamera(focal_px, (image.ppx, image.ppy), own.fx * baseline_mm)


def _is_same(sensor: Any, other: Any) -> bool:
    name = sdk().camera_info.name
    return bool(sensor.get_info(name) == other.get_info(name))
