"""Settings: one frozen tree, read from TOML, with `--set key=value` on top; and the TOML reader of all files.

Every mistake in a TOML file becomes one sentence with file, line, what was found and what would be valid.
Nothing is read from the environment. The tree says what to use; `assemble` knows which class that is.
"""

import math
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta, Struct
from msgspec.structs import replace

from haptigraph.errors import BadInput, unknown_name

__all__ = [
    "Config",
    "Document",
    "HapticsConfig",
    "PerceptionConfig",
    "RecordingConfig",
    "RunConfig",
    "SourceConfig",
    "TrialConfig",
    "load_config",
]

T = TypeVar("T")
Blame = Callable[[str, str], BadInput]
"""Make the error for (problem, path of keys)."""

UpToADayMs = Annotated[float, Meta(ge=1, le=86_400_000)]


class SourceConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Where images come from."""

    uri: str = "phantom:align_then_approach"
    """phantom:SCENARIO, teleop:SCENARIO (steered by a hand), camera:N, or the path of a video, a folder of
    images or a recording."""
    registration: str = ""
    """Path of the registration; empty: the one the source brings along."""
    jpeg_quality: Annotated[int, Meta(ge=0, le=100)] = 95
    """Cameras and the phantom pass every image through JPEG of this quality before perception sees it, so
    that a recording is small and still exact; 0: images stay raw and are recorded as PNG."""
    rate_hz: Annotated[float, Meta(ge=0.01, le=1000)] = 30.0
    """Images per second of a folder of images, and to ask of a camera; others bring their own."""
    loop: bool = False
    """Whether the phantom starts again when its scenario is over."""


class PerceptionConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """How the needle is found."""

    perceiver: str = "tracker"
    """tracker, or threshold, the paper's method; the other settings here are for that one."""
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
    """console, or trace:FILE.csv."""
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


class RecordingConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the run is kept."""

    path: str = ""
    """The MCAP file to write; empty: none."""


class TrialConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Whose run it is (pseudonyms only); stored in the recording."""

    participant: str = ""
    trial: str = ""


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


class Document:
    """A TOML text that can say where in it something is wrong.

    Args:
        text: The TOML text.
        file: Its name for messages.

    Raises:
        BadInput: If it is not TOML.
    """

    def __init__(self, text: str, file: str | Path) -> None:
        self.text, self.file = text, file
        try:
            self.data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            problem, _, place = str(error).partition(" (at ")
            place = place.rstrip(")") or "end of file"
            raise BadInput(f"not valid TOML: {_lower_first(problem)}", file, place) from None
        except RecursionError:
            raise BadInput("tables or lists are nested too deeply", file) from None

    @classmethod
    def read(cls, path: str | Path) -> "Document":
        """Read a TOML file.

        Raises:
            BadInput: If it cannot be read or is not TOML.
        """
        try:
            return cls(Path(path).read_text(encoding="utf-8-sig"), path)  # editors may put a mark in front
        except OSError as error:
            raise BadInput(f"cannot be read ({error.strerror})", path) from None
        except UnicodeDecodeError as error:
            raise BadInput(f"not UTF-8 text (byte {error.start})", path) from None

    def error(self, problem: str, path: str) -> BadInput:
        """Return the error that names the line of `path` ("state[2].feel")."""
        line = _line_of(self.text, path)
        return BadInput(problem, self.file, f"line {line}" if line else "")

    def convert(self, type_: type[T]) -> T:
        """Turn the document into a struct.

        Raises:
            BadInput: At an unknown or missing key, a number that is not finite, a value of the wrong kind.
        """
        return _convert(self.data, type_, self.error)


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
    return _convert(data, Config, lambda problem, _: BadInput(problem, "--set" if settings else path))


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


def _convert(data: Any, type_: type[T], error: Blame) -> T:
    _check_finite(data, "", error)
    _check_names(data, type_, "", error)
    try:
        return msgspec.convert(data, type_)
    except msgspec.ValidationError as invalid:
        problem, _, path = str(invalid).partition(" - at `$")
        path = path.rstrip("`").lstrip(".")
        found = _value_at(data, path)
        name = f"{path}: " if path else ""
        missing = re.match(r"Object missing required field `(\w+)`", problem)
        if missing:
            raise error(f"{name}key {missing[1]!r} is missing", path) from None
        told = "" if found is None or isinstance(found, dict) else f", found {found!r}"
        problem = problem.replace("`", "").replace("object", "table")
        raise error(f"{name}{_lower_first(problem)}{told}", path) from None


def _check_finite(value: Any, path: str, error: Blame) -> None:
    """Refuse nan and infinity, which pass every comparison that a check makes."""
    if isinstance(value, float) and not math.isfinite(value):
        raise error(f"{path}: expected a finite number, found {value}", path)
    inner = enumerate(value) if isinstance(value, list) else value.items() if isinstance(value, dict) else ()
    for key, item in inner:
        place = f"[{key}]" if isinstance(value, list) else f".{key}"
        _check_finite(item, (path + place).lstrip("."), error)


def _check_names(value: Any, type_: Any, path: str, error: Blame) -> None:
    """Refuse unknown keys and choices with the list of valid ones (msgspec would not list them)."""
    if get_origin(type_) is Literal and isinstance(value, str) and value not in get_args(type_):
        raise error(unknown_name(path.rpartition(".")[2], value, get_args(type_)), path)
    if isinstance(value, list):
        for number, item in enumerate(value):
            for inner in get_args(type_)[:1]:
                _check_names(item, inner, f"{path}[{number}]", error)
    elif isinstance(value, dict):
        struct = next((t for t in (type_, *get_args(type_)) if hasattr(t, "__struct_fields__")), None)
        if struct is None:
            return
        names = dict(zip(struct.__struct_encode_fields__, struct.__struct_fields__, strict=True))
        hints = get_type_hints(struct, include_extras=False)
        for key, item in value.items():
            inner_path = f"{path}.{key}" if path else key
            if key not in names:
                raise error(unknown_name("key", key, names), inner_path)
            _check_names(item, hints[names[key]], inner_path, error)


def _value_at(data: Any, path: str) -> Any:
    for part in re.findall(r"\w+", path):
        try:
            data = data[int(part)] if isinstance(data, list) else data[part]
        except (KeyError, IndexError, ValueError, TypeError):
            return None
    return data


def _line_of(text: str, path: str) -> int | None:
    """Find the line (from 1) of a key path like "state[2].feel"; its table's line if the key is inline."""
    parts = re.findall(r"(\w+)(?:\[(\d+)\])?", path)
    if not parts:
        return None
    keys = [name for name, _ in parts]
    number = int(parts[0][1] or 0)
    seen: dict[str, int] = {}
    table, table_line = "", None
    for line, content in enumerate(text.splitlines(), 1):
        header = re.match(r"\s*(\[\[?)\s*([\w.]+)\s*\]", content)
        if header:
            table = header[2]
            seen[table] = seen.get(table, -1) + 1
            if table == keys[0] and (header[1] == "[" or seen[table] == number):
                table_line = line
            elif table_line:
                return table_line
            continue
        key = re.match(r'\s*"?(\w+)"?\s*[.=]', content)
        if key and (
            (not table and key[1] == keys[0]) or (table_line and len(keys) > 1 and key[1] == keys[1])
        ):
            return line
    return table_line


def _lower_first(sentence: str) -> str:
    return sentence[:1].lower() + sentence[1:]
