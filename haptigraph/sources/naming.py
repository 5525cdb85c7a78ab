"""What sources are called: turn what a user wrote into the kind of source and what it takes.

"phantom:x" is a phantom, "clip.mp4" a video, "run.mcap" a recording. Knows no class and opens nothing but
the first bytes of a file.
"""

import re
from collections.abc import Container
from pathlib import Path

from haptigraph.config import SourceConfig
from haptigraph.errors import BadInput, NeedsRegistration

__all__ = ["CAMERAS", "MADE_NOW", "OCT_FILES", "SETTLED", "camera_device", "camera_size_px", "split_source"]

CAMERAS = ("camera", "realsense", "ros2")
"""Kinds that deliver in real time and at no other pace, and have no registration of their own."""
MADE_NOW = (*CAMERAS, "phantom", "teleop")
"""Kinds that make their images as they go."""
SETTLED = ("dicom", "images", "oct", "phantom", "realsense-file", "recording", "video")
"""Kinds whose next images nothing can change, so that they can be read ahead."""
OCT_FILES = (".vol", ".e2e", ".fda", ".eye")
"""What can only be B-scans, by suffix."""

DEFAULT_SCENARIO = "align_then_approach"
REALSENSE_FILES = (".db3", ".bag")
DICOM_MARK_AT, DICOM_MARK = 128, b"DICM"


def split_source(uri: str, kinds: Container[str]) -> tuple[str, str]:
    """Return the kind of a source and what it takes: "phantom:x" -> ("phantom", "x").

    Args:
        uri: What the user wrote.
        kinds: Those there are.

    Raises:
        BadInput: If it is neither a known kind nor an existing path.
    """
    kind, _, argument = uri.partition(":")
    if uri == "teleop":
        return kind, DEFAULT_SCENARIO
    if kind == "realsense" and Path(argument).suffix.lower() not in REALSENSE_FILES:
        return kind, argument
    if kind == "realsense":
        return "realsense-file", argument
    if argument and kind in kinds:
        if kind == "camera":
            camera_device(argument)
        return kind, argument
    path = Path(uri)
    if uri and path.is_dir():
        return "images", uri
    by_name = {
        ".mcap": "recording",
        **dict.fromkeys(OCT_FILES, "oct"),
        **dict.fromkeys(REALSENSE_FILES, "realsense-file"),
        ".dcm": "dicom",
    }
    if path.suffix.lower() in by_name:
        return by_name[path.suffix.lower()], uri
    if uri and path.exists():
        return "dicom" if _is_dicom(path) else "video", uri
    raise BadInput(
        "no such source; valid: phantom:SCENARIO, teleop:SCENARIO, camera:N, realsense[:SERIAL], ros2:TOPIC, "
        "oct:PATH, or the path of a video, a DICOM file, a folder of images, a recording (.mcap) or the "
        "RealSense SDK's (.db3)",
        uri or "''",
    )


def camera_device(which: str) -> int | str:
    """Return what OpenCV opens for camera:WHICH: a number, the path of a device, or the address of a stream.

    Raises:
        BadInput: If it is none of them.
    """
    if re.fullmatch("[0-9]{1,4}", which):
        return int(which)
    if "/" in which:
        return which
    raise BadInput(f"camera:{which} is no camera; camera:0 is the first")


def camera_size_px(asked: SourceConfig, registered_px: tuple[int, int] | None) -> tuple[int, int]:
    """Return the size to ask of a camera: as the settings say, or else as registered.

    Args:
        asked: The settings.
        registered_px: Width and height of the registered images, or of their part that is used.

    Raises:
        NeedsRegistration: If there is no registration.
        BadInput: If settings and registration contradict each other, or leave it open.
    """
    if registered_px is None:
        raise NeedsRegistration(asked.uri)
    asked_px = asked.width_px, asked.height_px
    if asked.crop_px and not all(asked_px):
        raise BadInput(
            "source.crop_px cuts a part out of a camera's image; say how large the whole one is with "
            "source.width_px and source.height_px"
        )
    if not all(asked_px):
        return registered_px
    if registered_px != asked_px and not asked.crop_px:
        asked_for, registered = ("{} x {} px".format(*size_px) for size_px in (asked_px, registered_px))
        raise BadInput(
            f"source.width_px and source.height_px say {asked_for}, but the registration is for {registered}"
        )
    return asked_px


def _is_dicom(path: Path) -> bool:
    """Tell DICOM by its mark; files from clinics often have no suffix."""
    try:
        with path.open("rb") as file:
            return file.read(DICOM_MARK_AT + len(DICOM_MARK))[DICOM_MARK_AT:] == DICOM_MARK
    except OSError:
        return False  # whoever opens it will say why
