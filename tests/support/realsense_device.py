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


class DepthCamera:
    """A D405 that streams colour of 128 x 96 px and depth of 64 x 48 px from one module."""

    def __init__(self, has_depth=True, baseline_mm=18.0):
        self.device = rs.software_device()
        self.device.register_info(rs.camera_info.name, "Intel RealSense D405")
        self.device.register_info(rs.camera_info.serial_number, SERIAL)
        self.sensor = self.device.add_sensor("Stereo Module")
        self.colour = self._stream(rs.stream.color, 1, (128, 96), 100.0, rs.format.bgr8, 3)
        self.depth = self._stream(rs.stream.depth, 2, (64, 48), 50.0, rs.format.z16, 2) if has_depth else None
        self.sensor.add_read_only_option(rs.option.depth_units, 0.0001)
        if baseline_mm is not None:
            self.sensor.add_read_only_option(rs.option.stereo_baseline, baseline_mm)
        if has_depth:
            same = rs.extrinsics()
            same.rotation, same.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [0, 0, 0]
            self.depth.register_extrinsics_to(self.colour, same)
            self.colour.register_extrinsics_to(self.depth, same)
        self.device.create_matcher(rs.matchers.default)

    def _stream(self, kind, uid, size_px, focal_px, fmt, bpp):
        stream, own = rs.video_stream(), rs.intrinsics()
        own.width, own.height = stream.width, stream.height = size_px
        own.fx = own.fy = focal_px
        own.ppx, own.ppy = (size_px[0] - 1) / 2, (size_px[1] - 1) / 2
        own.model, own.coeffs = rs.distortion.none, [0] * 5
        stream.type, stream.uid, stream.fps, stream.bpp, stream.fmt, stream.intrinsics = (
            kind,
            uid,
            30,
            bpp,
            fmt,
            own,
        )
        return self.sensor.add_video_stream(stream).as_video_stream_profile()

    def push(self, number, stamp_ms, image, depth):
        """Deliver an image with its depths like the camera."""
        for profile, pixels, bpp in ((self.depth, depth, 2), (self.colour, image, 3)):
            if profile is None:
                continue
            frame = rs.software_video_frame()
            frame.pixels, frame.bpp, frame.stride = pixels, bpp, bpp * pixels.shape[1]
            frame.timestamp, frame.domain = stamp_ms, rs.timestamp_domain.global_time
            frame.frame_number, frame.profile, frame.depth_units = number, profile, 0.0001
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
