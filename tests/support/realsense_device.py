"""A RealSense camera based on the SDK's software device: the SDK delivers the images that a test pushes."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyrealsense2 as rs

SERIAL = "130322270000"


class SoftwareCamera:
    """A D405 as the SDK presents it: colour comes from the stereo module."""

    def __init__(
        self, size_px=(128, 96), rate_hz=30, serial=SERIAL, colour=True, fmt=rs.format.bgr8, intrinsics=None
    ):
        self.size_px, self.fmt = size_px, fmt
        self.device = rs.software_device()
        self.device.register_info(rs.camera_info.name, "Intel RealSense D405")
        self.device.register_info(rs.camera_info.serial_number, serial)
        self.sensor = self.device.add_sensor("Stereo Module")
        stream = rs.video_stream()
        stream.type, stream.uid, stream.fps = rs.stream.color if colour else rs.stream.infrared, 1, rate_hz
        stream.width, stream.height = size_px
        stream.bpp, stream.fmt, stream.intrinsics = 3, fmt, intrinsics or rs.intrinsics()
        self.profile = self.sensor.add_video_stream(stream).as_video_stream_profile()

    def push(self, number, stamp_ms, image, domain=rs.timestamp_domain.global_time):
        """Deliver one image like the camera."""
        frame = rs.software_video_frame()
        frame.pixels, frame.bpp, frame.stride = image, 3, 3 * self.size_px[0]
        frame.timestamp, frame.domain, frame.frame_number, frame.profile = (
            stamp_ms,
            domain,
            number,
            self.profile,
        )
        self.sensor.on_video_frame(frame)


def record(path: Path, images: Sequence[np.ndarray], stamps_ms: Sequence[float], **options) -> None:
    """Record images to a file with the SDK."""
    height, width = images[0].shape[:2]
    camera = SoftwareCamera((width, height), **options)
    recorder = rs.recorder(str(path), camera.device)
    (sensor,) = recorder.query_sensors()
    frames = rs.frame_queue(10)
    sensor.open(sensor.get_stream_profiles()[0])
    sensor.start(frames)
    for number, (image, stamp_ms) in enumerate(zip(images, stamps_ms, strict=True)):
        camera.push(number, stamp_ms, image)
        frames.wait_for_frame(1000)
    sensor.stop()
    sensor.close()
    recorder.pause()
