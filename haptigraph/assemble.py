"""Turn a configuration into running parts: the only place that knows class names.

Classes are named by strings and imported when chosen, so that nothing heavy loads unasked.
"""

import datetime
import re
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from importlib import import_module, resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

import haptigraph
from haptigraph.clock import Clock, MonotonicClock, VirtualClock
from haptigraph.config import Config
from haptigraph.errors import BadInput, NeedsRegistration, unknown_name
from haptigraph.haptics.pattern import beyond
from haptigraph.haptics.tap import Listener, TappedDevice
from haptigraph.pipeline import Hand, Loop, Pipeline
from haptigraph.recording.schema import RunInfo
from haptigraph.recording.writer import Progress, RunWriter
from haptigraph.stages import Device, Sink, Source

if TYPE_CHECKING:
    from haptigraph.inference.procedure import Procedure
    from haptigraph.perception.registration import Registration

__all__ = [
    "DEVICES",
    "PERCEIVERS",
    "SOURCES",
    "build",
    "build_pipeline",
    "is_realtime",
    "load_procedure",
    "open_device",
    "open_source",
    "parse_procedure",
    "procedure_names",
]

PERCEIVERS = {
    "tracker": "haptigraph.perception.tracker:Tracker",
    "threshold": "haptigraph.perception.threshold:ThresholdPerceiver",
}
DEVICES = {
    "console": "haptigraph.haptics.console:ConsoleDevice",
    "trace": "haptigraph.haptics.trace:TraceDevice",
}
SOURCES = {
    "camera": "haptigraph.sources.camera:CameraSource",
    "images": "haptigraph.sources.images:ImagesSource",
    "phantom": "haptigraph.sources.phantom:PhantomSource",
    "recording": "haptigraph.sources.recording:RecordingSource",
    "teleop": "haptigraph.sources.teleop:TeleopSource",
    "video": "haptigraph.sources.video:VideoSource",
}
MADE_NOW = ("camera", "phantom", "teleop")  # sources that make their images as they go, in real time
SETTLED = ("images", "phantom", "recording", "video")  # sources whose next images nothing can change

DEFAULT_SCENARIO = "align_then_approach"
DEFAULT_TRACE = "touch.csv"


def build(
    config: Config,
    *,
    sinks: Sequence[Sink] = (),
    progress: Progress | None = None,
    listener: Listener | None = None,
) -> Loop:
    """Assemble everything a configuration asks for.

    Args:
        config: The configuration.
        sinks: Further takers of steps.
        progress: Told about work that takes long.
        listener: Told every amplitude that the device is told.

    Raises:
        BadInput: If a name, a file or a device in the configuration cannot be used.
        NeedsRegistration: If nothing says where the anatomy lies.
    """
    clock: Clock = MonotonicClock() if is_realtime(config) else VirtualClock()
    procedure = load_procedure(config.run.procedure)
    load_registration = _load("haptigraph.perception.registration:load_registration")
    given = load_registration(config.source.registration) if config.source.registration else None
    with ExitStack() as undo:
        source = open_source(config, clock, (given.width_px, given.height_px) if given else None)
        undo.callback(source.close)
        registration = given or _own_registration(source, config)
        pipeline = build_pipeline(config, registration, procedure)
        writer = _run_writer(config, source, registration, procedure, clock)
        if writer is not None:
            undo.callback(writer.discard)
        device = open_device(config.haptics.device)
        undo.callback(device.close)
        if listener is not None:
            device = TappedDevice(device, listener)
        hand = _hand(device, config, clock)
        undo.callback(hand.close)
        recorders: list[Sink] = []
        if writer is not None:
            recorder = _load("haptigraph.sinks.recorder:Recorder")
            recorders.append(recorder(writer, waits=isinstance(clock, VirtualClock), progress=progress))
            undo.callback(recorders[0].close)
        loop = Loop(
            pipeline,
            source=source,
            hand=hand,
            sinks=[*recorders, *sinks],
            clock=clock,
            stale_ms=config.run.stale_ms,
            notes=_notes(config, procedure, device),
        )
        undo.pop_all()
    return loop


def is_realtime(config: Config) -> bool:
    """Tell whether a run is paced by the clock: as the configuration says, or else as its source suggests.

    Raises:
        BadInput: If a camera is to run at any other pace.
    """
    kind, _ = _split_source(config.source.uri)
    realtime = kind in MADE_NOW if config.run.realtime is None else config.run.realtime
    if kind == "camera" and not realtime:
        raise BadInput(f"{config.source.uri} delivers in real time; --fast works with files and the phantom")
    return realtime


def build_pipeline(config: Config, registration: "Registration", procedure: "Procedure") -> Pipeline:
    """Assemble the four stages alone, for replay and evaluation.

    Raises:
        BadInput: If there is no such perceiver.
    """
    perceiver = _named(PERCEIVERS, "perceiver", config.perception.perceiver)
    perceive = perceiver(registration.straight, config.perception)
    if (slant := registration.image.straight_from_image) is not None:
        straightened = _load("haptigraph.perception.straightening:StraightenedPerceiver")
        perceive = straightened(perceive, registration, slant)
    return Pipeline(
        perceive=perceive,
        build_scene=_load("haptigraph.scene.builder:SchemaSceneBuilder")(procedure.schema),
        reason=_load("haptigraph.inference.engine:RuleEngine")(procedure),
        render=_load("haptigraph.haptics.renderer:GrammarRenderer")(procedure.patterns),
    )


def _split_source(uri: str) -> tuple[str, str]:
    """Return the kind of a source and what it takes: "phantom:x" -> ("phantom", "x").

    Raises:
        BadInput: If it is neither a known kind nor an existing path.
    """
    kind, _, argument = uri.partition(":")
    if uri == "teleop":
        return kind, DEFAULT_SCENARIO
    if argument and kind in SOURCES:
        return kind, argument
    path = Path(uri)
    if uri and path.is_dir():
        return "images", uri
    if path.suffix == ".mcap":
        return "recording", uri
    if uri and path.exists():
        return "video", uri
    raise BadInput(
        "no such source; valid: phantom:SCENARIO, teleop:SCENARIO, camera:N, or the path of a video, a "
        "folder of images or a recording (.mcap)",
        uri or "''",
    )


def open_source(config: Config, clock: Clock, size_px: tuple[int, int] | None = None) -> Source:
    """Open the source of a configuration.

    Args:
        config: Its [source] table counts.
        clock: Stamps live images; with a virtual one, reading a file waits however long it takes.
        size_px: Width and height to ask a camera for, as they were registered.

    Raises:
        BadInput: If it cannot be opened.
        NeedsRegistration: If it is a camera and its image size is not known.
    """
    kind, argument = _split_source(config.source.uri)
    if config.source.loop and kind != "phantom":
        raise BadInput(f"source.loop works with phantom:SCENARIO only, found {config.source.uri!r}")
    options: dict[str, Callable[[], dict[str, Any]]] = {
        "camera": lambda: {"size_px": size_px, "rate_hz": config.source.rate_hz, "clock": clock},
        "images": lambda: {"rate_hz": config.source.rate_hz},
        "phantom": lambda: {"loop": config.source.loop},
    }
    given: Any = _camera_number(argument) if kind == "camera" else argument
    if kind == "camera" and size_px is None:
        raise NeedsRegistration(config.source.uri)
    source: Source = _load(SOURCES[kind])(given, **options.get(kind, dict)())
    if kind in MADE_NOW and config.source.jpeg_quality:
        source = _load("haptigraph.sources.jpeg:JpegSource")(source, config.source.jpeg_quality)
    if kind in SETTLED:
        source = _load("haptigraph.sources.ahead:ReadAhead")(source, waits=isinstance(clock, VirtualClock))
    return source


def open_device(name: str) -> Device:
    """Open a haptic device: its name, and behind a colon what it needs.

    Raises:
        BadInput: If there is none of that name.
    """
    kind, _, argument = name.partition(":")
    device = _named(DEVICES, "device", kind)
    if kind == "trace":
        return device(argument or DEFAULT_TRACE)  # type: ignore[no-any-return]
    if argument:
        raise BadInput(f"device {kind!r} takes nothing behind a colon, found {name!r}")
    return device()  # type: ignore[no-any-return]


def procedure_names() -> list[str]:
    """Return the names of the procedures that ship with haptigraph."""
    files = resources.files("haptigraph.procedures").iterdir()
    return sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml"))


def load_procedure(name: str) -> "Procedure":
    """Load a procedure by its name, or from a path that ends in .toml.

    Raises:
        BadInput: If there is none, or it is not sound.
    """
    from haptigraph.inference.procedure import load_procedure

    if name.endswith(".toml"):
        return load_procedure(name, _measure_shapes())
    if name not in procedure_names():
        raise BadInput(unknown_name("procedure", name, procedure_names()) + ", or the path of a .toml file")
    file = resources.files("haptigraph.procedures").joinpath(f"{name}.toml")
    return parse_procedure(file.read_text(encoding="utf-8"), f"procedure {name}")


def parse_procedure(text: str, file: str) -> "Procedure":
    """Load a procedure from text; `file` names it in errors."""
    from haptigraph.inference.procedure import parse_procedure

    return parse_procedure(text, file, _measure_shapes())


def _measure_shapes() -> dict[str, tuple[tuple[str, str], ...]]:
    from haptigraph.scene.relations import MEASURES

    return {name: measure.shapes for name, measure in MEASURES.items()}


def _own_registration(source: Source, config: Config) -> "Registration":
    from haptigraph.perception.registration import parse_registration

    if source.registration is not None:
        return parse_registration(source.registration, f"registration of {config.source.uri}")
    beside = Path(config.source.uri).parent / "registration.toml"
    hint = f"; there is one beside it: {beside}" if beside.is_file() else ""
    raise NeedsRegistration(config.source.uri, hint)


def _hand(device: Device, config: Config, clock: Clock) -> Hand:
    guard = _load("haptigraph.haptics.guard:Guard")(device, config.haptics)
    if isinstance(clock, MonotonicClock):
        return _load("haptigraph.haptics.player:Player")(guard, clock)  # type: ignore[no-any-return]
    return guard  # type: ignore[no-any-return]


def _notes(config: Config, procedure: "Procedure", device: Device) -> list[str]:
    notes = [note for pattern in procedure.patterns for note in beyond(pattern, device.capabilities)]
    if _split_source(config.source.uri)[0] == "teleop":
        notes.append(
            "the needle stands still until a hand steers it; `haptigraph live` offers a page for that"
        )
    return notes


def _run_writer(
    config: Config, source: Source, registration: "Registration", procedure: "Procedure", clock: Clock
) -> RunWriter | None:
    if not config.recording.path:
        return None
    utc_ns = time.time_ns()
    info = RunInfo(
        version=haptigraph.__version__,
        started_utc=datetime.datetime.fromtimestamp(utc_ns / 1e9, datetime.UTC).isoformat(),
        utc_offset_ns=utc_ns - clock.now_ns(),
        source=config.source.uri,
        rate_hz=source.rate_hz,
        config=msgspec.json.encode(config).decode(),
        registration=registration.text,
        registration_sha256=registration.sha256,
        procedure=procedure.text,
        procedure_sha256=procedure.sha256,
        participant=config.trial.participant,
        trial=config.trial.trial,
    )
    schema = procedure.schema
    measures = tuple(dict.fromkeys(schema.measure_name(relation) for relation in schema.relations))
    return RunWriter(config.recording.path, info, registration.image, measures)


def _camera_number(argument: str) -> int:
    if not re.fullmatch("[0-9]{1,4}", argument):
        raise BadInput(f"camera:{argument} is no camera; camera:0 is the first")
    return int(argument)


def _named(registry: dict[str, str], what: str, name: str) -> Any:
    if name not in registry:
        raise BadInput(unknown_name(what, name, registry))
    return _load(registry[name])


def _load(path: str) -> Any:
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)
