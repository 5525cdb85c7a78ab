"""Settings: one frozen tree, read from TOML and overridden by `--set key=value`.

Nothing is read from the environment. `assemble` turns the names in it into classes.
"""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

from msgspec import Meta, Struct
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.imaging import Rotation, Turn
from haptigraph.toml_document import Document, convert, warn_renamed

__all__ = [
    "Config",
    "HapticsConfig",
    "PerceptionConfig",
    "RecordingConfig",
    "RobotConfig",
    "RunConfig",
    "SourceConfig",
    "TrialConfig",
    "load_config",
]

Positive = Annotated[float, Meta(gt=0)]
Corner = Annotated[int, Meta(ge=0, le=16384)]
Side = Annotated[int, Meta(ge=16, le=16384)]
NeedleMm = Annotated[float, Meta(gt=0, le=3)]
TaperMm = Annotated[float, Meta(ge=0, le=100)]
Box = tuple[Corner, Corner, Side, Side]
UpToADayMs = Annotated[float, Meta(ge=1, le=86_400_000)]


class SourceConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Where images come from."""

    uri: str = "phantom:align_then_approach"
    """phantom[:SCENARIO], teleop[:SCENARIO] (steered by you), camera:N, realsense[:SERIAL], ros2:TOPIC,
    rosbag:PATH, oct:PATH, or the path of a video, a DICOM file, a folder of images, or a recording, also one
    of the RealSense SDK; or MODULE:CLASS[:ARGUMENT] of your own (docs/how_to/sources.md)."""
    registration: str = ""
    """Path of the registration; empty: the source's own."""
    jpeg_quality: Annotated[int, Meta(ge=0, le=100)] = 90
    """JPEG quality for images of cameras and the phantom, applied before perception so that recordings stay
    small and replay exactly; 0: images stay raw and are recorded as PNG."""
    rate_hz: Annotated[float, Meta(ge=0.01, le=1000)] = 30.0
    """Images per second to request from a camera, and of files without times: image folders, some DICOM."""
    width_px: Annotated[int, Meta(ge=0, le=16384)] = 0
    """Width to request from a camera; 0: as registered, or else 1280."""
    height_px: Annotated[int, Meta(ge=0, le=16384)] = 0
    """Height to request from a camera; 0: as registered, or else 720."""
    fourcc: Annotated[str, Meta(pattern="^([A-Za-z0-9]{4})?$")] = "MJPG"
    """Pixel format to request from camera:N, four letters; empty: the driver's default."""
    target_mm: Annotated[float, Meta(ge=-40, le=40)] | None = None
    """Position of the target along the retina from its lowest point, positive to the surgeon's right; unset:
    as registered."""
    loop: bool = False
    """Whether the phantom restarts its scenario when it ends."""
    axial_mm_per_px: Positive | None = None
    """Pixel height of oct:PATH; unset: as the file states (docs/how_to/oct_sources.md)."""
    lateral_mm_per_px: Positive | None = None
    """Pixel width of oct:PATH; unset: as the file states."""
    rotate_deg: Rotation = 0
    """Clockwise rotation of every image of a camera or file, so that the eye is upright
    (docs/reference/conventions.md#upright)."""
    mirror: bool = False
    """Whether left and right of every image are exchanged, after the rotation."""
    depth: bool | None = None
    """Whether realsense[:SERIAL] reads depth images, too (docs/explanation/depth.md); unset: if the
    registration has [depth]."""
    crop_px: Box | None = None
    """Region of interest: left, top, width, height; unset: the whole image."""
    bits: Annotated[int, Meta(ge=0, le=16)] = 0
    """How many bits 16-bit images of oct:PATH use; 0: all of them."""
    volume_as_sequence: bool = False
    """Whether a volume is played as if its B-scans were a time series of one position."""
    slice_mm: Positive | None = None
    """Distance between the B-scans of a volume of oct:PATH (docs/explanation/oct_volumes.md); unset: as the
    file states."""
    volume_axes: Literal["slices,rows,columns", "rows,slices,columns", "rows,columns,slices"] = (
        "slices,rows,columns"
    )
    """Axes of the NumPy arrays of oct:PATH; rows go down, along the beam."""

    def __post_init__(self) -> None:
        if bool(self.width_px) != bool(self.height_px):
            raise ValueError("set both width_px and height_px; found only one")

    @property
    def turn(self) -> Turn:
        """How the images are turned."""
        return Turn(self.rotate_deg, self.mirror)


class PerceptionConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """How the needle is found."""

    perceiver: str = "auto"
    """tracker, forceps, bscan, segmentation, volume, or threshold (the paper's method, for which most of the
    settings here are); auto: the one that reports most of the procedure's entities; or MODULE:CLASS of your
    own (docs/how_to/own_classes.md)."""
    model: str = ""
    """TOML file of the segmentation's ONNX model (docs/explanation/segmentation.md); empty: the one that
    ships with haptigraph. Of `volume`: .npz file of an instrument that `register --volumes` learned; empty:
    any needle over a retina."""
    polarity: Literal["dark", "bright", "auto"] = "auto"
    """Whether the needle is darker or brighter than the background."""
    block_size_px: Annotated[int, Meta(ge=3, le=501)] = 51
    """Side length of the window of the local mean; odd."""
    offset_grey: Annotated[float, Meta(gt=0, le=255)] = 10.0
    """Minimum difference of a needle pixel from the local mean, in grey levels."""
    alpha: Annotated[float, Meta(gt=0, le=1)] = 0.5
    """Weight of the new image in the moving average; 1: no smoothing."""
    needle_mm: tuple[NeedleMm, NeedleMm, TaperMm] | None = None
    """Diameters of the needle at its tip and of its shaft, and length of the taper between them; unset: its
    width is measured in the image. Depth is that of its surface, so the tip's z depends on them
    (docs/explanation/depth.md)."""

    def __post_init__(self) -> None:
        if self.block_size_px % 2 == 0:
            raise ValueError(f"block_size_px must be odd, found {self.block_size_px}")


class HapticsConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Device and limits of the haptic output."""

    device: str = "console"
    """console, trace:FILE.csv, audio[:FILE.wav], gamepad:N, serial:PORT?pin=N, drv2605:PORT?motor=lra,
    ros2[:TOPIC], or MODULE:CLASS[:ARGUMENT] of your own (docs/how_to/devices.md)."""
    force: str = ""
    """Device that pushes the hand, and is moved by it to steer: inverse3[:HOST:PORT], crtk:NAMESPACE,
    forcedimension[:N] or simulated (docs/how_to/force_devices.md); empty: none."""
    profile: str = ""
    """Path of the device's profile (TOML), which has the drive for every amplitude; empty: they are equal
    (docs/how_to/devices.md#how-strong-it-feels-profiles)."""
    max_amplitude: Annotated[float, Meta(ge=0, le=1)] = 1.0
    """Limit of what the device is set to: of the drive, if there is a profile. 0: nothing vibrates, and no
    force is exerted."""
    deadman_ms: Annotated[float, Meta(gt=0, le=1000)] = 150.0
    """The device is silenced, and the hand let go, after this time without a new command."""
    max_on_ms: UpToADayMs = 60_000.0
    """Longest vibration without a pause; then it pauses for `rest_ms`."""
    rest_ms: UpToADayMs = 500.0
    """Duration of that pause."""
    accept_assumed: bool = False
    """Whether the device may vibrate although the registration assumes positions that nobody measured
    (docs/reference/conventions.md#what-is-assumed)."""
    weakest_amplitude: Annotated[float, Meta(gt=0, le=1)] | None = None
    """Amplitude of the procedure's weakest vibration; the strongest keeps its own, the others lie in between.
    A calibration sets it (docs/how_to/study.md). Unset: as in the procedure."""
    sham_seed: Annotated[int, Meta(ge=0, le=2**53)] | None = None
    """Seed of a sham: vibration at random times, whatever the state, which warns of nothing
    (docs/how_to/study.md); unset: none."""
    sham_duty: Annotated[float, Meta(gt=0, lt=1)] = 0.5
    """Expected share of the time that a sham vibrates."""

    @property
    def outputs(self) -> str:
        """The device, and that with force if there is one."""
        return f"{self.device} or {self.force}" if self.force else self.device


class RunConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """How the loop runs."""

    procedure: str = "subretinal_injection"
    """Name of a procedure that ships with haptigraph, or the path of a TOML file."""
    realtime: bool | None = None
    """Whether the clock paces images; unset: yes for cameras and the phantom, no for files."""
    stale_ms: Annotated[float, Meta(ge=1, le=60_000)] = 100.0
    """The needle counts as lost after this time without a new image."""
    leader: str = ""
    """What steers teleop:SCENARIO or a robot: gamepad:N, keys, joy[:TOPIC] or crtk:NAMESPACE
    (docs/how_to/teleoperation.md#leaders); empty: only the live page."""
    bridges: tuple[str, ...] = ()
    """Where the run is published live: ros2[:NAMESPACE], openigtlink[:PORT], lsl, foxglove[:PORT]
    (docs/how_to/bridges.md)."""


class RecordingConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the run is recorded."""

    path: str = ""
    """MCAP file to write; empty: none."""
    store_video: bool = True
    """Whether a video file is stored once, instead of each of its images as PNG, where that takes less space
    (docs/reference/recordings.md#videos)."""


class RobotConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """The robot that holds the instrument. A run reads it, and moves it only if `steer` is set."""

    uri: str = ""
    """crtk:NAMESPACE, servo:NODE or simulated (docs/how_to/robots.md); empty: none."""
    setup: str = ""
    """Path of robot.toml, which says where the eye is; empty: the robot's tip is recorded, not compared."""
    steer: bool = False
    """Whether the live page may move it; `live --steer` sets it."""
    latency_ms: Annotated[float, Meta(ge=-5000, le=5000)] = 0.0
    """How much later than measured the robot stamps its poses, on the clock of the images (`sync-check`)."""
    timing_sd_ms: Annotated[float, Meta(ge=0, le=1000)] = 5.0
    """Standard deviation of that time."""


class TrialConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Participant and trial (pseudonyms only), stored in the recording."""

    participant: str = ""
    """Pseudonym of the participant."""
    trial: str = ""
    """Name of the trial."""
    phase: str = ""
    """Initial phase, if the procedure has phases (docs/reference/procedures.md#phases); empty: its first."""
    touch_output: str = ""
    """Outputs whose test pulse the participant felt, joined by " + "; set by `study run`
    (docs/how_to/study.md)."""


class Config(Struct, frozen=True, forbid_unknown_fields=True):
    """Everything a run depends on besides the files it names."""

    source: SourceConfig = SourceConfig()
    perception: PerceptionConfig = PerceptionConfig()
    haptics: HapticsConfig = HapticsConfig()
    run: RunConfig = RunConfig()
    recording: RecordingConfig = RecordingConfig()
    robot: RobotConfig = RobotConfig()
    trial: TrialConfig = TrialConfig()

    def silenced(self) -> "Config":
        """Return the same configuration with an amplitude limit of 0."""
        return replace(self, haptics=replace(self.haptics, max_amplitude=0.0))

    def with_perceiver(self, name: str) -> "Config":
        """Return the same configuration with another perceiver."""
        return replace(self, perception=replace(self.perception, perceiver=name))

    def with_depth(self) -> "Config":
        """Return the same configuration, but depth images are read."""
        return replace(self, source=replace(self.source, depth=True))


def load_config(path: str | Path | None = None, settings: Sequence[str] = ()) -> Config:
    """Read a configuration.

    Args:
        path: A TOML file; None: the defaults.
        settings: "table.key=value" strings that override it; the value is TOML or else a plain string.

    Raises:
        BadInput: If a key is unknown or a value not valid.
    """
    document = Document.read(path) if path else Document("", "configuration")
    document.convert(Config)  # reports the file's own errors, with their lines
    data = document.data
    for setting in settings:
        _override(data, setting)
    return convert(data, Config, lambda problem, _: BadInput(problem, "--set" if settings else path))


def _override(data: dict[str, Any], setting: str) -> None:
    key, equals, text = setting.partition("=")
    if not equals or not key:
        raise BadInput(f"found {setting!r}; expected KEY=VALUE, for example perception.alpha=1", "--set")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError):
        value = text
    (*parents, name), type_ = _resolve(key.strip())
    for parent in parents:
        data = data.setdefault(parent, {})
        if not isinstance(data, dict):
            raise BadInput(f"{key!r}: {parent!r} is a value, not a table", "--set")
    data[name] = text if type_ is str and not isinstance(value, str) else value  # trial.trial=3 means "3"


def _resolve(key: str) -> tuple[list[str], Any]:
    """Return the names in a setting's key, those of earlier versions replaced, and the setting's type."""
    names: list[str] = []
    type_: Any = Config
    for name in key.split("."):
        if (new := getattr(type_, "OLD_KEYS", {}).get(name)) is not None:
            warn_renamed(name, new, key, lambda problem, _: BadInput(problem, "--set"))
        names.append(new or name)
        type_ = get_type_hints(type_).get(names[-1]) if hasattr(type_, "__struct_fields__") else None
    return names, type_
