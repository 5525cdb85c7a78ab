"""Settings: one frozen tree, read from TOML, with `--set key=value` on top.

Nothing is read from the environment. The tree says what to use; `assemble` knows which class that is.
"""

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

from msgspec import Meta, Struct
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.toml_document import Document, convert

__all__ = [
    "Config",
    "HapticsConfig",
    "PerceptionConfig",
    "RecordingConfig",
    "RunConfig",
    "SourceConfig",
    "TrialConfig",
    "load_config",
]

Positive = Annotated[float, Meta(gt=0)]
Corner = Annotated[int, Meta(ge=0, le=16384)]
Side = Annotated[int, Meta(ge=16, le=16384)]
Box = tuple[Corner, Corner, Side, Side]
UpToADayMs = Annotated[float, Meta(ge=1, le=86_400_000)]


class SourceConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Where images come from."""

    uri: str = "phantom:align_then_approach"
    """phantom:SCENARIO, teleop:SCENARIO (steered by a hand), camera:N, realsense[:SERIAL], ros2:TOPIC, or
    the path of a video, a DICOM file, a folder of images, a recording, or one of the RealSense SDK."""
    registration: str = ""
    """Path of the registration; empty: the one the source brings along."""
    jpeg_quality: Annotated[int, Meta(ge=0, le=100)] = 95
    """Cameras and the phantom pass every image through JPEG of this quality before perception sees it, so
    that a recording is small and still exact; 0: images stay raw and are recorded as PNG."""
    rate_hz: Annotated[float, Meta(ge=0.01, le=1000)] = 30.0
    """Images per second to ask of a camera, and of files that tell no time: folders of images, some DICOM."""
    width_px: Annotated[int, Meta(ge=0, le=16384)] = 0
    """Width to ask of a camera; 0: as registered, or else 1280."""
    height_px: Annotated[int, Meta(ge=0, le=16384)] = 0
    """Height to ask of a camera; 0: as registered, or else 720."""
    fourcc: Annotated[str, Meta(pattern="^([A-Za-z0-9]{4})?$")] = "MJPG"
    """Format to ask of camera:N, four letters; empty: the driver's own choice."""
    target_mm: Annotated[float, Meta(ge=-40, le=40)] | None = None
    """Along the retina from its lowest point to the target, positive to the right; unset: as registered."""
    loop: bool = False
    """Whether the phantom starts again when its scenario is over."""
    axial_mm_per_px: Positive | None = None
    """Height of a pixel of oct:PATH; unset: as the file says."""
    lateral_mm_per_px: Positive | None = None
    """Width of a pixel of oct:PATH; unset: as the file says."""
    crop_px: Box | None = None
    """Left, top, width and height of the part of every image that is used; unset: the whole image."""
    bits: Annotated[int, Meta(ge=0, le=16)] = 0
    """How many bits 16-bit images of oct:PATH really use; 0: all of them."""
    volume_as_sequence: bool = False
    """Whether a volume is played as if its B-scans showed one place, one after the other."""

    def __post_init__(self) -> None:
        if bool(self.width_px) != bool(self.height_px):
            raise ValueError("width_px and height_px go together, found only one of them")


class PerceptionConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """How the needle is found."""

    perceiver: str = "auto"
    """tracker, forceps, bscan, segmentation, or threshold, the paper's method, which most settings here are
    for; auto: the one that sees what the procedure speaks of."""
    model: str = ""
    """The TOML of the segmentation's ONNX model; empty: the one that ships with haptigraph."""
    polarity: Literal["dark", "bright", "auto"] = "auto"
    """Whether the needle is darker or brighter than what is behind it."""
    block_size_px: Annotated[int, Meta(ge=3, le=501)] = 51
    """Side of the neighbourhood the local mean is taken over; odd."""
    offset_grey: Annotated[float, Meta(gt=0, le=255)] = 10.0
    """How many grey levels a needle pixel must differ from the local mean."""
    alpha: Annotated[float, Meta(gt=0, le=1)] = 0.5
    """Weight of the new image in the moving average; 1: no smoothing."""

    def __post_init__(self) -> None:
        if self.block_size_px % 2 == 0:
            raise ValueError(f"block_size_px must be odd, found {self.block_size_px}")


class HapticsConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """What may reach the hand."""

    device: str = "console"
    """console, trace:FILE.csv, audio[:FILE.wav], gamepad:N, serial:PORT?pin=N or ros2[:TOPIC]."""
    max_amplitude: Annotated[float, Meta(ge=0, le=1)] = 1.0
    deadman_ms: Annotated[float, Meta(gt=0, le=1000)] = 150.0
    """Silence when no fresh command came for so long."""
    max_on_ms: UpToADayMs = 60_000.0
    """Longest vibration without a pause; after it the hand rests for `rest_ms`."""
    rest_ms: UpToADayMs = 500.0


class RunConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """How the loop runs."""

    procedure: str = "subretinal_injection"
    """Name of a procedure that ships with haptigraph, or the path of a TOML file."""
    realtime: bool | None = None
    """Pace images by the clock; unset: yes for cameras and the phantom, no for files."""
    stale_ms: Annotated[float, Meta(ge=1, le=60_000)] = 100.0
    """Without a new image for so long, the needle counts as lost."""
    bridges: tuple[str, ...] = ()
    """Who else is told live: ros2[:NAMESPACE], openigtlink[:PORT], lsl, foxglove[:PORT]."""


class RecordingConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the run is kept."""

    path: str = ""
    """The MCAP file to write; empty: none."""


class TrialConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Whose run it is (pseudonyms only); stored in the recording."""

    participant: str = ""
    trial: str = ""
    phase: str = ""
    """The phase the run begins in, where the procedure has phases; empty: its first."""


class Config(Struct, frozen=True, forbid_unknown_fields=True):
    """Everything a run depends on besides the files it names."""

    source: SourceConfig = SourceConfig()
    perception: PerceptionConfig = PerceptionConfig()
    haptics: HapticsConfig = HapticsConfig()
    run: RunConfig = RunConfig()
    recording: RecordingConfig = RecordingConfig()
    trial: TrialConfig = TrialConfig()

    def with_perceiver(self, name: str) -> "Config":
        """Return the same configuration with another perceiver."""
        return replace(self, perception=replace(self.perception, perceiver=name))


def load_config(path: str | Path | None = None, settings: tuple[str, ...] = ()) -> Config:
    """Read a configuration.

    Args:
        path: A TOML file; None: the defaults.
        settings: "key.key=value" strings that override it; the value is TOML or else a plain string.

    Raises:
        BadInput: If a key is unknown or a value not valid.
    """
    document = Document.read(path) if path else Document("", "configuration")
    document.convert(Config)  # so that the file's own mistakes are told with their lines
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
    *parents, name = key.strip().split(".")
    for parent in parents:
        data = data.setdefault(parent, {})
        if not isinstance(data, dict):
            raise BadInput(f"{key!r}: {parent!r} is a value, not a table", "--set")
    data[name] = value if isinstance(value, str) or not _is_text(key.strip()) else text


def _is_text(key: str) -> bool:
    """Tell whether a setting is a text, so that trial.trial=3 means "3"."""
    table: Any = Config
    for name in key.split("."):
        table = get_type_hints(table).get(name) if hasattr(table, "__struct_fields__") else None
    return table is str
