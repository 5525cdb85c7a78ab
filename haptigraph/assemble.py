"""Turn a configuration into running parts: the only place that knows class names.

Classes are named by strings and imported when chosen, so that nothing heavy loads unasked.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from importlib import import_module, resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptigraph.clock import Clock, MonotonicClock, VirtualClock
from haptigraph.config import Config
from haptigraph.errors import BadInput, NeedsRegistration, unknown_name
from haptigraph.haptics.observed_device import Listener, ObservedDevice
from haptigraph.haptics.pattern import beyond
from haptigraph.pipeline import Hand, Loop, Pipeline
from haptigraph.recording.writer import Progress, RunWriter
from haptigraph.run_header import run_info
from haptigraph.sources.naming import CAMERAS, MADE_NOW, SETTLED, camera_size_px, split_source
from haptigraph.stages import Device, Perceiver, Sink, Source
from haptigraph.version import __version__

if TYPE_CHECKING:
    from haptigraph.inference.procedure import Procedure
    from haptigraph.registration.registered import Registered

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
    "perceiver_name",
    "procedure_names",
]

PERCEIVERS = {
    "tracker": "haptigraph.perception.needle.tracker:Tracker",
    "bscan": "haptigraph.perception.oct.bscan:BscanPerceiver",
    "forceps": "haptigraph.perception.forceps.forceps:ForcepsPerceiver",
    "segmentation": "haptigraph.perception.oct.segmentation:SegmentationPerceiver",
    "threshold": "haptigraph.perception.baseline.threshold:ThresholdPerceiver",
}
DEVICES = {
    "audio": "haptigraph.haptics.audio:AudioDevice",
    "console": "haptigraph.haptics.console:ConsoleDevice",
    "gamepad": "haptigraph.haptics.gamepad:GamepadDevice",
    "ros2": "haptigraph.haptics.ros2:Ros2Device",
    "serial": "haptigraph.haptics.firmata:FirmataDevice",
    "trace": "haptigraph.haptics.trace:TraceDevice",
}
WATCHED = ("gamepad", "ros2", "serial")  # devices that would go on if the run died
MOVES = (*WATCHED, "audio")  # devices that someone feels
SOURCES = {
    "camera": "haptigraph.sources.cameras.uvc:CameraSource",
    "dicom": "haptigraph.sources.oct.dicom:DicomSource",
    "images": "haptigraph.sources.images:ImagesSource",
    "oct": "haptigraph.sources.oct.oct:OctSource",
    "phantom": "haptigraph.sources.phantom:PhantomSource",
    "realsense": "haptigraph.sources.cameras.realsense:RealsenseSource",
    "realsense-file": "haptigraph.sources.cameras.realsense_file:RealsenseFile",
    "recording": "haptigraph.sources.recording:RecordingSource",
    "ros2": "haptigraph.sources.cameras.ros2:Ros2Source",
    "teleop": "haptigraph.sources.teleop:TeleopSource",
    "video": "haptigraph.sources.video:VideoSource",
}


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
    config = config.with_perceiver(perceiver_name(config, procedure))  # a recording says which it was
    load_registration = _load("haptigraph.registration.loading:load_registration")
    given = load_registration(config.source.registration) if config.source.registration else None
    with ExitStack() as undo:
        source = open_source(config, clock, (given.width_px, given.height_px) if given else None)
        undo.callback(source.close)
        source = _load("haptigraph.sources.phased:phased")(
            source, procedure.schema.phases, config.trial.phase
        )
        registration = given or _own_registration(source, config)
        if config.source.target_mm is not None:
            registration = _load("haptigraph.registration.retarget:with_target")(
                registration, config.source.target_mm
            )
        pipeline = build_pipeline(config, registration, procedure)
        info = run_info(config, source, registration, procedure, clock, __version__)
        measures = procedure.schema.measure_names
        writer: RunWriter | None = None
        if config.recording.path:
            writer = RunWriter(config.recording.path, info, registration.image, measures)
            undo.callback(writer.discard)
        bridges = []
        if config.run.bridges:
            run = _load("haptigraph.bridges.bridge:Run")(info, registration.image, measures, clock, source)
            bridges = _load("haptigraph.bridges.opening:open_bridges")(config.run.bridges, run)
            undo.callback(lambda: [bridge.close() for bridge in bridges])
        device = open_device(config.haptics.device)
        undo.callback(device.close)
        for hears in (*(bridge.felt for bridge in bridges), *((listener,) if listener else ())):
            device = ObservedDevice(device, hears)
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
            sinks=[*bridges, *recorders, *sinks],
            clock=clock,
            stale_ms=config.run.stale_ms,
            notes=_notes(config, source, procedure, device),
        )
        undo.pop_all()
    return loop


def is_realtime(config: Config) -> bool:
    """Tell whether a run is paced by the clock: as the configuration says, or else as its source suggests.

    Raises:
        BadInput: If a camera, an actuator or a bridge is to run at any other pace.
    """
    kind, _ = split_source(config.source.uri, SOURCES)
    moves = config.haptics.device.partition(":")[0] in MOVES and not config.haptics.device.endswith(".wav")
    suggested = moves or kind in MADE_NOW or bool(config.run.bridges)
    realtime = suggested if config.run.realtime is None else config.run.realtime
    if not realtime and (moves or kind in CAMERAS or config.run.bridges):
        bridges = " ".join(f"--bridge {name}" for name in config.run.bridges)
        which = config.haptics.device if moves else config.source.uri if kind in CAMERAS else bridges
        raise BadInput(f"{which} works in real time; --fast is for files, the phantom, console and trace")
    return realtime


def build_pipeline(
    config: Config, registration: "Registered", procedure: "Procedure", perceive: Perceiver | None = None
) -> Pipeline:
    """Assemble the four stages alone, for replay, evaluation and simulated studies.

    Args:
        config: Names the perceiver.
        registration: Where the anatomy lies.
        procedure: Rules and touch.
        perceive: Takes the place of the perceiver that the configuration names.

    Raises:
        BadInput: If there is no such perceiver.
    """
    return Pipeline(
        perceive=perceive or _perceiver(config, registration, procedure),
        build_scene=_load("haptigraph.scene.builder:SchemaSceneBuilder")(procedure.schema),
        reason=_load("haptigraph.inference.engine:RuleEngine")(procedure),
        render=_load("haptigraph.haptics.renderer:GrammarRenderer")(procedure.patterns),
    )


def perceiver_name(config: Config, procedure: "Procedure") -> str:
    """Return which perceiver is used; "auto": the first that sees most of what a procedure speaks of."""
    if config.perception.perceiver != "auto":
        return config.perception.perceiver
    wanted = {entity.name for entity in procedure.schema.entities}
    return max(PERCEIVERS, key=lambda name: len(wanted & _load(PERCEIVERS[name]).sees))


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
    kind, argument = split_source(config.source.uri, SOURCES)
    if config.source.loop and kind != "phantom":
        raise BadInput(f"source.loop works with phantom:SCENARIO only, found {config.source.uri!r}")
    asked = config.source
    size_px = camera_size_px(asked, size_px) if kind in CAMERAS else None
    camera = {"size_px": size_px, "rate_hz": asked.rate_hz, "clock": clock}
    options: dict[str, dict[str, Any]] = {
        "camera": {**camera, "fourcc": asked.fourcc},
        "dicom": {"rate_hz": asked.rate_hz},
        "images": {"rate_hz": asked.rate_hz},
        "oct": {"asked": asked},
        "phantom": {"loop": asked.loop, "target_mm": asked.target_mm},
        "realsense": camera,
        "ros2": camera,
        "teleop": {"clock": clock, "target_mm": asked.target_mm},
    }
    source: Source = _load(SOURCES[kind])(argument, **options.get(kind, {}))
    if asked.crop_px and kind != "oct":  # which cuts by itself
        source = _load("haptigraph.sources.oct.crop:CropSource")(source, asked.crop_px, asked.uri)
    if kind in MADE_NOW and config.source.jpeg_quality:
        source = _load("haptigraph.sources.jpeg:JpegSource")(source, config.source.jpeg_quality)
    if kind in SETTLED:
        source = _load("haptigraph.sources.read_ahead:ReadAhead")(
            source, waits=isinstance(clock, VirtualClock)
        )
    return source


def open_device(name: str) -> Device:
    """Open a haptic device: its name, and behind a colon what it needs.

    Raises:
        BadInput: If there is none of that name.
    """
    kind, _, argument = name.partition(":")
    if kind in WATCHED:
        return _load("haptigraph.haptics.watchdog:WatchedDevice")(DEVICES[kind], argument)  # type: ignore[no-any-return]
    return _named(DEVICES, "device", kind)(argument)  # type: ignore[no-any-return]


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

    return {name: tuple(measure.shapes) for name, measure in MEASURES.items()}


def _perceiver(config: Config, registration: "Registered", procedure: "Procedure") -> Perceiver:
    name = perceiver_name(config, procedure)
    perceiver = _named(PERCEIVERS, "perceiver", name)
    _load("haptigraph.registration.oct:check_fits")(name, perceiver, registration)
    perceive: Perceiver = perceiver(registration.frontal, config.perception)
    if (tilt := registration.image.frontal_from_image) is not None:
        tilt_corrected = _load("haptigraph.perception.tilt_correction:TiltCorrectedPerceiver")
        perceive = tilt_corrected(perceive, registration, tilt)
    phased = _load("haptigraph.perception.phase:PhasedPerceiver")
    return phased(perceive, phases) if (phases := procedure.schema.phases) else perceive


def _own_registration(source: Source, config: Config) -> "Registered":
    from haptigraph.registration.loading import parse_registration

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


def _notes(config: Config, source: Source, procedure: "Procedure", device: Device) -> list[str]:
    beyonds = (note for pattern in procedure.patterns for note in beyond(pattern, device.capabilities))
    notes = [*getattr(source, "notes", ()), *(f"{config.haptics.device}: {note}" for note in beyonds)]
    if split_source(config.source.uri, SOURCES)[0] == "teleop":
        notes.append(
            "the needle stands still until a hand steers it: the page of `haptigraph live`, or --bridge ros2"
        )
    return notes


def _named(registry: dict[str, str], what: str, name: str) -> Any:
    if name not in registry:
        raise BadInput(unknown_name(what, name, registry))
    return _load(registry[name])


def _load(path: str) -> Any:
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)
