"""Turn a configuration into running parts: the only place that knows class names, imported when chosen."""

from collections.abc import Sequence
from contextlib import ExitStack
from importlib import resources
from typing import TYPE_CHECKING, Any

from haptigraph.clock import Clock, MonotonicClock, VirtualClock
from haptigraph.config import Config
from haptigraph.errors import BadInput, unknown_name
from haptigraph.haptics.observed_device import DeliveryLog, Listener, ObservedDevice, confirmed, is_felt
from haptigraph.haptics.profiles.profile import DeviceProfile, open_profile
from haptigraph.imaging import UPRIGHT
from haptigraph.importing import chosen as _named
from haptigraph.importing import load as _load
from haptigraph.perception.entities import ENTITIES, ROBOT_TIP
from haptigraph.pipeline import HapticOutput, Loop, Pipeline
from haptigraph.run_device import DEVICES, open_device
from haptigraph.run_header import own_classes, run_info
from haptigraph.run_notes import run_notes
from haptigraph.run_registration import registration_of
from haptigraph.run_settings import suited
from haptigraph.sources.naming import CAMERAS, GENERATED, PREFETCHABLE, camera_size_px, split_source
from haptigraph.stages import Device, Perceiver, PerceiverClass, Sink, Source, check_members
from haptigraph.version import __version__

if TYPE_CHECKING:
    from haptigraph.inference.procedure import Procedure
    from haptigraph.recording.writer import Progress
    from haptigraph.registration.registered import BaseRegistration

__all__ = [
    "DEVICES",
    "PERCEIVERS",
    "SOURCES",
    "build",
    "build_pipeline",
    "is_live",
    "is_realtime",
    "load_procedure",
    "open_device",
    "open_source",
    "parse_procedure",
    "perceiver_class",
    "perceiver_name",
    "procedure_names",
]

PERCEIVERS = {
    "tracker": "haptigraph.perception.needle.tracker:Tracker",
    "bscan": "haptigraph.perception.oct.bscan:BscanPerceiver",
    "forceps": "haptigraph.perception.forceps.forceps:ForcepsPerceiver",
    "segmentation": "haptigraph.perception.oct.segmentation:SegmentationPerceiver",
    "threshold": "haptigraph.perception.baseline.threshold:ThresholdPerceiver",
    "volume": "haptigraph.perception.volume.perceiver:VolumePerceiver",
}
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
    "rosbag": "haptigraph.sources.rosbag:RosbagSource",
    "teleop": "haptigraph.sources.teleop:TeleopSource",
    "video": "haptigraph.sources.video:VideoSource",
}


def build(
    config: Config,
    *,
    sinks: Sequence[Sink] = (),
    progress: "Progress | None" = None,
    listener: Listener | None = None,
) -> Loop:
    """Assemble the loop that a configuration describes.

    Args:
        config: The configuration.
        sinks: Further consumers of steps.
        progress: Reports the progress of slow work.
        listener: Receives every output of the device.

    Raises:
        BadInput: If a name, a file or a device in the configuration cannot be used.
        NeedsRegistration: If there is no registration of the anatomy.
    """
    clock: Clock = MonotonicClock() if is_realtime(config) else VirtualClock()
    procedure = load_procedure(config.run.procedure)
    config = config.with_perceiver(perceiver_name(config, procedure))  # so that a recording names it
    load_registration = _load("haptigraph.registration.loading:load_registration")
    given = load_registration(config.source.registration) if config.source.registration else None
    if config.source.depth is None and given is not None and given.depth is not None:
        config = config.with_depth()
    with ExitStack() as undo:
        source = open_source(config, clock, (given.width_px, given.height_px) if given else None)
        undo.callback(source.close)
        phased = _load("haptigraph.sources.phased:phased")
        source = phased(source, procedure.schema.phases, config.trial.phase)
        registration = registration_of(config, source, given)
        source = _load("haptigraph.sources.depth_region:with_depth_region")(source, registration)
        robot, robot_setup = None, source.robot_setup or ""
        if config.robot.uri or config.robot.setup or config.robot.steer:
            robot, robot_setup = _load("haptigraph.run_robot:open_readings")(config.robot, source, clock)
            undo.callback(robot.close)
        config = suited(config, source, registration)
        profile, profile_text = open_profile(config.haptics)
        pipeline = build_pipeline(config, registration, procedure)
        texts = robot_setup, profile_text, own_classes(config, {*PERCEIVERS, *SOURCES, *DEVICES})
        info = run_info(config, source, registration, procedure, clock, __version__, *texts)
        video = _load("haptigraph.sources.naming:video_to_store")(config, SOURCES)
        writer = None
        if path := config.recording.path:
            run_writer = _load("haptigraph.recording.writer:RunWriter")
            writer = run_writer(path, info, registration.image, procedure.schema.measure_names, video)
            undo.callback(writer.discard)
        bridges = []
        if config.run.bridges:
            context = _load("haptigraph.bridges.bridge:RunContext")
            run = context(info, registration.image, procedure.schema.measure_names, clock, source.teleop)
            bridges = _load("haptigraph.bridges.opening:open_bridges")(config.run.bridges, run)
            undo.callback(lambda: [bridge.close() for bridge in bridges])
        leaders = _load("haptigraph.teleop.leaders.opening:steered")(config, source.teleop, clock)
        undo.callback(lambda: [leader.close() for leader in leaders])
        name, log = config.haptics.device, DeliveryLog()
        device = confirmed(open_device(name), name, log)
        undo.callback(device.close)
        for observer in (*(bridge.send_output for bridge in bridges), *((listener,) if listener else ())):
            device = ObservedDevice(device, observer)
        vibration = _output(device, config, clock, profile)
        output, force, hands = vibration, None, ()
        if config.haptics.force:
            add_force = _load("haptigraph.run_force:with_force")
            output, force, hands = add_force(config, vibration, source, robot, clock)
        undo.callback(output.close)
        recorders: list[Sink] = []
        if writer is not None:
            recorder = _load("haptigraph.sinks.recorder:Recorder")
            recorders.append(recorder(writer, waits=isinstance(clock, VirtualClock), progress=progress))
            undo.callback(recorders[0].close)
        loop = Loop(
            pipeline,
            source=source,
            output=output,
            sinks=[*bridges, *leaders, *hands, *recorders, *sinks],
            clock=clock,
            stale_ms=config.run.stale_ms,
            deliveries=log,
            robot=robot,
            force=force,
            notes=run_notes(config, source, procedure, device, registration, perceiver_class, profile),
        )
        loop.report.note_limits(registration.assumed, config.haptics)
        undo.pop_all()
    return loop


def is_realtime(config: Config) -> bool:
    """Return whether the clock paces a run: as configured, or else by the kind of source and device.

    Raises:
        BadInput: If a camera, an actuator, a leader or a bridge is to run at any other pace.
    """
    kind, device, run = split_source(config.source.uri, SOURCES)[0], config.haptics.device, config.run
    bound = [device] * is_felt(device) + [config.source.uri] * is_live(kind)
    bound += [f"--force {config.haptics.force}"] * bool(config.haptics.force)
    bound += [f"--leader {run.leader}"] * bool(run.leader) + [f"--bridge {name}" for name in run.bridges]
    realtime = bool(bound) or kind in GENERATED if run.realtime is None else run.realtime
    if bound and not realtime:
        raise BadInput(f"{bound[0]} works in real time; --fast is for files, the phantom, console and trace")
    return realtime


def build_pipeline(
    config: Config,
    registration: "BaseRegistration",
    procedure: "Procedure",
    perceive: Perceiver | None = None,
) -> Pipeline:
    """Assemble the four stages alone, for replay, evaluation and simulated studies.

    Args:
        config: Names the perceiver.
        registration: Position of the anatomy in the images.
        procedure: Rules and haptic patterns.
        perceive: Replaces the configured perceiver.

    Raises:
        BadInput: If there is no such perceiver.
    """
    return Pipeline(
        perceive=perceive or _perceiver(config, registration, procedure),
        build_scene=_load("haptigraph.scene.builder:SchemaSceneBuilder")(procedure.schema),
        reason=_load("haptigraph.inference.engine:RuleEngine")(procedure),
        render=_load("haptigraph.haptics.renderer:make_renderer")(
            procedure.patterns, procedure.forces, config.haptics
        ),
    )


def perceiver_name(config: Config, procedure: "Procedure") -> str:
    """Return the configured perceiver; for "auto" the first that finds most of the procedure's entities."""
    if config.perception.perceiver != "auto":
        return config.perception.perceiver
    wanted = {entity.name for entity in procedure.schema.entities}
    known = ENTITIES | {name: perceiver_class(name).entities for name in PERCEIVERS.keys() - ENTITIES.keys()}
    return max(PERCEIVERS, key=lambda name: len(wanted & known[name]))


def open_source(config: Config, clock: Clock, size_px: tuple[int, int] | None = None) -> Source:
    """Open the source of a configuration.

    Args:
        config: Its [source] table is used.
        clock: Stamps live images; with a virtual clock, reading a file never times out.
        size_px: Registered width and height, to request from a camera.

    Raises:
        BadInput: If the source cannot be opened or lacks a member of `Source`.
        NeedsRegistration: If the source is a camera of unknown image size.
    """
    (kind, argument), settings = split_source(config.source.uri, SOURCES), config.source
    if settings.loop and kind != "phantom":
        raise BadInput(f"source.loop works with phantom:SCENARIO only, found {settings.uri!r}")
    if kind in CAMERAS:
        size_px = camera_size_px(settings, settings.turn.size_before_px(size_px) if size_px else None)
    rate = {"rate_hz": settings.rate_hz}
    camera = {**rate, "size_px": size_px, "clock": clock}
    options: dict[str, dict[str, Any]] = {
        "camera": {**camera, "fourcc": settings.fourcc},
        **dict.fromkeys(("dicom", "images", "rosbag"), rate),
        "oct": {"settings": settings},
        "phantom": {"loop": settings.loop, "target_mm": settings.target_mm},
        "realsense": {**camera, "depth": bool(settings.depth)},
        "ros2": camera,
        "teleop": {"clock": clock, "target_mm": settings.target_mm},
    }
    is_own = kind not in SOURCES
    given = {"clock": clock} if is_own and is_live(kind) else options.get(kind, {})
    source: Source = _named(SOURCES, "source", kind)(argument, **given)
    check_members(source, Source, f"source {kind}" if is_own else f"source {kind} ({SOURCES[kind]})")
    if is_own:
        source = _load("haptigraph.run_own:OwnSource")(kind, source, is_live=is_live(kind))
    if settings.crop_px and kind != "oct":  # which crops by itself
        source = _load("haptigraph.sources.oct.crop:CropSource")(source, settings.crop_px, settings.uri)
    if settings.turn != UPRIGHT:
        source = _load("haptigraph.sources.turned:turned")(source, kind, settings)
    waits, read_ahead = isinstance(clock, VirtualClock), _load("haptigraph.sources.reading:ReadAhead")
    if (kind in GENERATED or is_live(kind)) and settings.jpeg_quality:
        if kind in PREFETCHABLE:  # so that one image is made while the previous one is compressed
            source = read_ahead(source, waits=waits)
        source = _load("haptigraph.sources.jpeg:JpegSource")(source, settings.jpeg_quality)
    return read_ahead(source, waits=waits) if kind in PREFETCHABLE else source


def procedure_names() -> list[str]:
    """Return the names of the procedures that ship with haptigraph."""
    files = resources.files("haptigraph.procedures").iterdir()
    return sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml"))


def load_procedure(name: str) -> "Procedure":
    """Load a procedure by its name, or from a path that ends in .toml.

    Raises:
        BadInput: If it does not exist or is not valid.
    """
    if name.endswith(".toml"):
        load = _load("haptigraph.inference.procedure:load_procedure")
        return load(name, _load("haptigraph.scene.relations:MEASURES"))  # type: ignore[no-any-return]
    if name not in procedure_names():
        raise BadInput(unknown_name("procedure", name, procedure_names()) + ", or the path of a .toml file")
    file = resources.files("haptigraph.procedures").joinpath(f"{name}.toml")
    return parse_procedure(file.read_text(encoding="utf-8"), f"procedure {name}")


def parse_procedure(text: str, file: str) -> "Procedure":
    """Load a procedure from text; `file` names it in errors."""
    parse = _load("haptigraph.inference.procedure:parse_procedure")
    return parse(text, file, _load("haptigraph.scene.relations:MEASURES"))  # type: ignore[no-any-return]


def _perceiver(config: Config, registration: "BaseRegistration", procedure: "Procedure") -> Perceiver:
    name = perceiver_name(config, procedure)
    perceiver = perceiver_class(name)
    _load("haptigraph.registration.oct:check_fits")(name, perceiver.images, registration)
    _load("haptigraph.inference.coverage:check_margins")(procedure, name, perceiver)
    perceive: Perceiver = perceiver(registration.frontal, config.perception)
    if name not in PERCEIVERS:
        perceive = _load("haptigraph.run_own:OwnPerceiver")(name, perceiver, registration.anatomy, perceive)
    if (tilt := registration.image.frontal_from_image) is not None:
        tilt_corrected = _load("haptigraph.perception.tilt_correction:TiltCorrectedPerceiver")
        perceive = tilt_corrected(perceive, registration, tilt)
    if (plane := registration.depth) is not None:
        in_space = _load("haptigraph.perception.depth.perceiver:DepthPerceiver")
        perceive = in_space(perceive, registration, plane, config.perception.needle_mm)
    if ROBOT_TIP in [entity.name for entity in procedure.schema.entities]:
        with_robot = _load("haptigraph.perception.robot_tip:RobotTipPerceiver")
        perceive = with_robot(perceive, config.robot.timing_sd_ms)
    phased = _load("haptigraph.perception.phase:PhasedPerceiver")
    return phased(perceive, phases) if (phases := procedure.schema.phases) else perceive


def perceiver_class(name: str) -> PerceiverClass:
    """Return the class of perceivers of a name, or the user's own that "module:Class" names.

    Raises:
        BadInput: If there is none, or it lacks a member of `PerceiverClass`.
    """
    perceiver: PerceiverClass = _named(PERCEIVERS, "perceiver", name)
    path = f" ({PERCEIVERS[name]})" if name in PERCEIVERS else ""
    check_members(perceiver, PerceiverClass, f"perceiver {name}{path}")
    return perceiver


def is_live(kind: str) -> bool:
    """Return whether sources of a kind set the pace: cameras, and those of the user's own that say so."""
    if kind in SOURCES:
        return kind in CAMERAS
    return bool(getattr(_named(SOURCES, "source", kind), "is_live", False))


def _output(device: Device, config: Config, clock: Clock, profile: DeviceProfile | None) -> HapticOutput:
    guard: HapticOutput = _load("haptigraph.haptics.guard:Guard")(device, config.haptics, profile)
    player = _load("haptigraph.haptics.player:Player") if isinstance(clock, MonotonicClock) else None
    return player(guard, clock) if player else guard
