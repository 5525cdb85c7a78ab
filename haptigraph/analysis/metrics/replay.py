"""Replay a recording and compare it step by step, under its own procedure or another."""

from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
from msgspec import Struct

from haptigraph import assemble
from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.config import Config
from haptigraph.errors import BadInput
from haptigraph.importing import is_own, module_sha256
from haptigraph.inference.coverage import unreported_notes
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Step
from haptigraph.recording.header import Losses
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.registered import BaseRegistration

__all__ = ["Difference", "ReplayReport", "recorded_config", "recorded_registration", "replay", "replay_steps"]

COMPARED = ("observation", "graph", "conclusion", "command")


class Difference(Struct, frozen=True):
    """The first step that differs."""

    step: int
    time_s: float
    message: str
    """The first message of the step that differs."""
    recorded: str
    replayed: str


class ReplayReport(Struct):
    """The result of a replay."""

    steps: int = 0
    identical: int = 0
    first: Difference | None = None
    dropped_images: int = 0
    """Images that perception processed but the recording lacks; steps that depend on them may differ."""
    differing_images: int = 0
    """Images of a video that its decoder here gives other pixels than during the run."""
    decoder: str = ""
    """What decoded them during the run."""
    is_whole: bool = True
    is_being_written: bool = False
    losses: Losses | None = None
    """What is missing, if the recording was recovered from a damaged one."""
    assumed: tuple[str, ...] = ()
    """What the recorded registration assumes, by name."""
    notes: tuple[str, ...] = ()
    """By which profile the device played, whether a perceiver of the user's own has changed, and which states
    cannot occur because the recording's perceiver does not report what they need."""
    recorded: RunMeasures = msgspec.field(default_factory=RunMeasures)
    replayed: RunMeasures = msgspec.field(default_factory=RunMeasures)


def replay(
    path: str | Path,
    procedure: str | None = None,
    progress: Progress | None = None,
    watch: Callable[[Step, Step], None] | None = None,
) -> ReplayReport:
    """Replay a recording.

    Args:
        path: The recording.
        procedure: Another procedure to apply; None: the recorded one.
        progress: Called with the progress.
        watch: Called with every step, as recorded and as replayed.

    Raises:
        BadInput: If recording or procedure cannot be used, or there is no complete step.
    """
    reader = RunReader(path)
    steps, dropped_images = reader.count()
    if not steps:
        raise BadInput("has no complete step to replay", path)
    applied = _procedure(reader, procedure)
    report = ReplayReport(
        notes=_notes(reader, applied),
        dropped_images=dropped_images,
        is_whole=reader.is_whole,
        is_being_written=reader.is_being_written,
        losses=reader.losses,
        decoder=reader.info.decoder,
        assumed=recorded_registration(reader).assumed,
        recorded=RunMeasures.under(_procedure(reader, None)),
        replayed=RunMeasures.under(applied),
    )
    start_ns = None
    for recorded, replayed in replay_steps(reader, procedure):
        start_ns = recorded.stamp_ns if start_ns is None else start_ns
        difference = _compare(report.steps, (recorded.stamp_ns - start_ns) / 1e9, recorded, replayed)
        report.steps += 1
        report.identical += difference is None
        report.first = report.first or difference
        report.recorded.add(recorded)
        report.replayed.add(replayed)
        if watch is not None:
            watch(recorded, replayed)
        if progress is not None:
            progress("replaying", report.steps, steps)
    report.differing_images = reader.differing_images
    return report


def replay_steps(reader: RunReader, procedure: str | None = None) -> Iterator[tuple[Step, Step]]:
    """Yield every recorded step with the step that the pipeline now makes of the same capture.

    Raises:
        BadInput: If the recording was made without images, or with a perceiver that cannot be imported.
    """
    config = recorded_config(reader)
    perceiver = config.perception.perceiver
    if is_own(perceiver):
        _own_note(reader, perceiver)
    elif perceiver not in (*assemble.PERCEIVERS, "auto"):  # that of a simulated participant, without images
        raise BadInput(
            f"was made without images (perceiver {perceiver}), so it cannot be replayed", reader.path
        )
    pipeline = assemble.build_pipeline(
        config,
        recorded_registration(reader),
        _procedure(reader, procedure),
    )
    for capture, recorded in reader.records():
        yield recorded, pipeline.step(capture)


def recorded_config(reader: RunReader) -> Config:
    """Return the configuration of a recorded run.

    Raises:
        BadInput: If it cannot be read.
    """
    try:
        return msgspec.json.decode(reader.info.config, type=Config)
    except msgspec.DecodeError as error:
        raise BadInput(f"configuration in it cannot be read: {error}", reader.path) from None


def recorded_registration(reader: RunReader) -> BaseRegistration:
    """Return the registration of a recorded run.

    Raises:
        BadInput: If it is not valid.
    """
    return parse_registration(reader.info.registration, f"registration in {reader.path}")


def _procedure(reader: RunReader, name: str | None) -> Procedure:
    if name:
        return assemble.load_procedure(name)
    return assemble.parse_procedure(reader.info.procedure, f"procedure in {reader.path}")


def _notes(reader: RunReader, procedure: Procedure) -> tuple[str, ...]:
    info = reader.info
    played = f"the device played amplitudes by its profile, sha256 {info.device_profile_sha256[:12]}"
    notes: tuple[str, ...] = (played,) if info.device_profile else ()
    name = assemble.perceiver_name(recorded_config(reader), procedure)
    if is_own(name):
        notes += (_own_note(reader, name),)
    elif name not in assemble.PERCEIVERS:
        return notes
    return (*notes, *unreported_notes(procedure, name, assemble.perceiver_class))


def _own_note(reader: RunReader, perceiver: str) -> str:
    """Return whether a perceiver of the user's own is still that of the run, in one sentence.

    Raises:
        BadInput: If it cannot be imported.
    """
    try:
        assemble.perceiver_class(perceiver)
    except BadInput as error:
        raise BadInput(
            f"cannot be replayed without the perceiver of its run: {error.problem}", reader.path
        ) from None
    lines = reader.info.own_classes.splitlines()
    recorded = next((line for line in lines if line.startswith("perceiver ")), "")
    before, now = recorded.removeprefix(f"perceiver {perceiver}").strip(), module_sha256(perceiver)
    changed = (
        "is unchanged since the run" if before == now else "has changed since the run, so steps may differ"
    )
    whether = f"its module {changed}" if before and now else "whether it has changed is not known"
    return f"perceiver {perceiver} is not part of haptigraph; {whether}"


def _compare(number: int, time_s: float, recorded: Step, replayed: Step) -> Difference | None:
    for message in COMPARED:
        before, after = (msgspec.json.encode(getattr(step, message)) for step in (recorded, replayed))
        if before != after:
            return Difference(number, time_s, message, before.decode(), after.decode())
    return None
