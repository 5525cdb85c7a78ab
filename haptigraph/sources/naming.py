"""Parse the name of a source into its kind and argument.

"phantom:x" is a phantom, "clip.mp4" a video, "run.mcap" a recording. Opens at most the first bytes of a file.
"""

import re
from collections.abc import Container
from pathlib import Path

from haptigraph.config import Config, SourceConfig
from haptigraph.errors import BadInput, NeedsRegistration
from haptigraph.importing import is_own, split_own

__all__ = [
    "CAMERAS",
    "DEFAULT_SCENARIO",
    "GENERATED",
    "OCT_FILES",
    "PREFETCHABLE",
    "camera_device",
    "camera_size_px",
    "is_simulated",
    "split_source",
    "video_to_store",
]

CAMERAS = ("camera", "realsense", "ros2")
"""Kinds that deliver in real time only and bring no registration."""
GENERATED = (*CAMERAS, "phantom", "teleop")
"""Kinds that capture or draw their images during the run."""
PREFETCHABLE = ("dicom", "images", "oct", "phantom", "realsense-file", "recording", "rosbag", "video")
"""Kinds whose next images do not depend on the run, so that they can be read ahead."""
OCT_FILES = (".vol", ".e2e", ".fda", ".eye")
"""Suffixes of files that can only be OCT."""

SIMULATED = ("phantom", "teleop")
"""Kinds that show a simulated eye; without an argument the default scenario's."""
DEFAULT_SCENARIO = "align_then_approach"
REALSENSE_FILES = (".db3", ".bag")
DICOM_MAGIC_OFFSET, DICOM_MAGIC = 128, b"DICM"


def split_source(uri: str, kinds: Container[str]) -> tuple[str, str]:
    """Return the kind and argument of a source: "phantom:x" -> ("phantom", "x").

    The kind of a source of the user's own is "module:Class".

    Args:
        uri: The name, as the user wrote it.
        kinds: The kinds that exist.

    Raises:
        BadInput: If it is neither a known kind nor an existing path.
    """
    kind, _, argument = uri.partition(":")
    if is_own(uri) and kind not in kinds and not Path(uri).exists():
        return split_own(uri)
    if uri in SIMULATED:
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
        return "rosbag" if (path / "metadata.yaml").is_file() else "images", uri
    kind_by_suffix = {
        ".mcap": "recording",
        **dict.fromkeys(OCT_FILES, "oct"),
        **dict.fromkeys(REALSENSE_FILES, "realsense-file"),
        ".dcm": "dicom",
    }
    if path.suffix.lower() in kind_by_suffix:
        return kind_by_suffix[path.suffix.lower()], uri
    if uri and path.exists():
        return "dicom" if _is_dicom(path) else "video", uri
    raise _no_such_source(uri)


def _no_such_source(uri: str) -> BadInput:
    path = Path(uri)
    if uri and (path.suffix or len(path.parts) > 1) and ":" not in uri:
        return BadInput("file not found; `haptigraph sources` lists what SOURCE can be", uri)
    return BadInput(
        "no such source; valid: phantom[:SCENARIO], teleop[:SCENARIO], camera:N, realsense[:SERIAL], "
        "ros2:TOPIC, rosbag:PATH, oct:PATH, or the path of a video, DICOM file, folder of images, recording "
        "(.mcap) or one of the RealSense SDK (.db3), or MODULE:CLASS of your own",
        uri or "''",
    )


def camera_device(which: str) -> int | str:
    """Return what OpenCV opens for camera:WHICH: a number, the path of a device, or the URL of a stream.

    Raises:
        BadInput: If it is none of these.
    """
    if re.fullmatch("[0-9]{1,4}", which):
        return int(which)
    if "/" in which:
        return which
    raise BadInput(f"camera:{which} is no camera number, device path or URL; the first camera is camera:0")


def is_simulated(uri: str) -> bool:
    """Return whether a source shows a simulated eye."""
    return uri.partition(":")[0] in SIMULATED


def camera_size_px(settings: SourceConfig, registered_px: tuple[int, int] | None) -> tuple[int, int]:
    """Return the size to request from a camera: as configured, or else as registered.

    Args:
        settings: The configured size and crop.
        registered_px: Width and height of the registered images, after cropping.

    Raises:
        NeedsRegistration: If there is no registration.
        BadInput: If settings and registration contradict each other, or do not determine the size.
    """
    if registered_px is None:
        raise NeedsRegistration(settings.uri)
    size_px = settings.width_px, settings.height_px
    if settings.crop_px and not all(size_px):
        raise BadInput(
            "source.crop_px crops a camera's images; set the size of the whole image with "
            "source.width_px and source.height_px"
        )
    if not all(size_px):
        return registered_px
    if registered_px != size_px and not settings.crop_px:
        configured, registered = ("{} x {} px".format(*each_px) for each_px in (size_px, registered_px))
        raise BadInput(
            f"source.width_px and source.height_px are {configured}, but the registration is for {registered}"
        )
    return size_px


def video_to_store(config: Config, kinds: Container[str]) -> Path | None:
    """Return the video file whose images a source delivers as they are, if its recording is to contain it."""
    kind, argument = split_source(config.source.uri, kinds)
    is_unchanged = kind == "video" and not config.source.crop_px
    return Path(argument) if is_unchanged and config.recording.store_video else None


def _is_dicom(path: Path) -> bool:
    """Recognise DICOM by its magic bytes; files from clinics often have no suffix."""
    try:
        with path.open("rb") as file:
            return file.read(DICOM_MAGIC_OFFSET + len(DICOM_MAGIC))[DICOM_MAGIC_OFFSET:] == DICOM_MAGIC
    except OSError:
        return False  # opening the source reports the error
