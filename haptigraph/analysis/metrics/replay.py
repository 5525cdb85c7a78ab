"""Replay a recording and compare it step by step, under its own procedure or another."""

from collections import Counter
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path

import msgspec
from msgspec import Struct

from haptigraph import assemble
from haptigraph.analysis.metrics.differing import differing_parts, largest_difference
from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.config import Config
from haptigraph.errors import BadInput
from haptigraph.importing import is_own, module_sha256
from haptigraph.inference.coverage import unreported_notes
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Step
from haptigraph.pipeline import Pipeline
from haptigraph.recording.header import Losses
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.registered import BaseRegistration
from haptigraph.version import __version__

__all__ = [
    "Difference",
    "Differing",
    "ReplayReport",
    "own_note",
    "recorded_config",
    "recorded_procedure",
    "recorded_registration",
    "replay",
    "replay_pipeline",
    "replay_steps",
]

COMPARED = ("observation", "graph", "conclusion", "command")


class Difference(Struct, frozen=True):
    """The first step that differs."""

    step: int
    time_s: float
    message: str
    """The first message of the step that differs."""
    recorded: str
    """The parts of it that differ, in words."""
    replayed: str


class Differing(Struct):
    """Steps that differ in one respect; `add` all steps in order."""

    steps: int = 0
    lasts_s: float = 0.0
    """How long they last; a step lasts until the following one."""
    first_step: int | None = None
    """From 0; None: no step differs."""
    first_s: float = 0.0
    recorded: str = ""
    """What the first of them had."""
    replayed: str = ""
    since_s: float | None = None
    """When the newest step began, if it differs."""

    def add(self, step: int, time_s: float, recorded: str, replayed: str, *, is_other: bool) -> None:
        """Add the next step, with the name of what it had in both runs."""
        if self.since_s is not None:
            self.lasts_s += time_s - self.since_s
        self.since_s = time_s if is_other else None
        if not is_other:
            return
        if self.first_step is None:
            self.first_step, self.first_s, self.recorded, self.replayed = step, time_s, recorded, replayed
        self.steps += 1


class ReplayReport(Struct):
    """The result of a replay."""

    steps: int = 0
    identical: int = 0
    first: Difference | None = None
    difference: float | None = 0.0
    """The largest of two numbers, if steps differ in numbers alone; None: something else differs, too."""
    states: Differing = msgspec.field(default_factory=Differing)
    """Steps with another surgical state."""
    haptics: Differing = msgspec.field(default_factory=Differing)
    """Steps that command another pattern, or one with other settings."""
    recorded_patterns: Counter[str] = msgspec.field(default_factory=Counter)
    """Steps by the pattern that they command."""
    replayed_patterns: Counter[str] = msgspec.field(default_factory=Counter)
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
    """By which profile the device played, which other version recorded it, whether a perceiver of the user's
    own has changed, and which states cannot occur because the recording's perceiver does not report what
    they need."""
    recorded: RunMeasures = msgspec.field(default_factory=RunMeasures)
    replayed: RunMeasures = msgspec.field(default_factory=RunMeasures)

    @property
    def states_differ(self) -> int:
        """Number of steps with another surgical state."""
        return self.states.steps

    @property
    def haptics_differ(self) -> int:
        """Number of steps with another haptic output."""
        return self.haptics.steps


def replay(
    path: str | Path,
    procedure: str | Procedure | None = None,
    progress: Progress | None = None,
    watch: Callable[[Step, Step], None] | None = None,
) -> ReplayReport:
    """Replay a recording.

    Args:
        path: The recording.
        procedure: Another procedure to apply, or its name; None: the recorded one.
        progress: Called with the progress.
        watch: Called with every step, as recorded and as replayed.

    Raises:
        BadInput: If recording or procedure cannot be used, or there is no complete step.
    """
    reader = RunReader(path)
    if next(reader.places(), None) is None:
        raise BadInput("has no complete step to replay", path)
    steps = reader.count()[0] if progress is not None else 0
    applied = _procedure(reader, procedure)
    report = ReplayReport(
        notes=_notes(reader, applied),
        is_whole=reader.is_whole,
        is_being_written=reader.is_being_written,
        losses=reader.losses,
        decoder=reader.info.decoder,
        assumed=recorded_registration(reader).assumed,
        recorded=RunMeasures.under(recorded_procedure(reader)),
        replayed=RunMeasures.under(applied),
    )
    start_ns = None
    for recorded, replayed in replay_steps(reader, applied):
        start_ns = recorded.stamp_ns if start_ns is None else start_ns
        time_s = (recorded.stamp_ns - start_ns) / 1e9
        differing = _differing(recorded, replayed)
        if differing is not None and report.first is None:
            message, before, after = differing
            report.first = Difference(report.steps, time_s, message, *differing_parts(before, after))
        if differing is not None and report.difference is not None:
            by = _numbers_differ_by(recorded, replayed)
            report.difference = None if by is None else max(by, report.difference)
        _count(report, time_s, recorded, replayed)
        report.steps += 1
        report.identical += differing is None
        report.recorded.add(recorded)
        report.replayed.add(replayed)
        if watch is not None:
            watch(recorded, replayed)
        if progress is not None:
            progress("replaying", report.steps, steps)
    report.differing_images = reader.differing_images
    report.dropped_images = reader.dropped_images
    return report


def replay_steps(reader: RunReader, procedure: str | Procedure | None = None) -> Iterator[tuple[Step, Step]]:
    """Yield every recorded step with the step that the pipeline now makes of the same capture."""
    pipeline = replay_pipeline(reader, procedure)
    for capture, recorded in reader.records():
        yield recorded, pipeline.step(capture)


def replay_pipeline(reader: RunReader, procedure: str | Procedure | None = None) -> Pipeline:
    """Return the pipeline that replays a recording.

    Raises:
        BadInput: If the recording has no images or its perceiver cannot be imported, or the procedure cannot
            be used.
    """
    config = recorded_config(reader)
    perceiver = config.perception.perceiver
    if is_own(perceiver):
        own_note(reader, perceiver)
    elif perceiver not in (*assemble.PERCEIVERS, "auto"):  # that of a simulated participant, without images
        raise BadInput(
            f"was made without images (perceiver {perceiver}), so it cannot be replayed", reader.path
        )
    return assemble.build_pipeline(config, recorded_registration(reader), _procedure(reader, procedure))


def recorded_config(reader: RunReader) -> Config:
    """Return the configuration of a recorded run.

    Raises:
        BadInput: If it cannot be read.
    """
    try:
        return msgspec.json.decode(reader.info.config, type=Config)
    except msgspec.DecodeError as error:
        raise BadInput(f"configuration in it cannot be read: {error}", reader.path) from None


def recorded_procedure(reader: RunReader) -> Procedure:
    """Return the procedure of a recorded run.

    Raises:
        BadInput: If it is not valid.
    """
    try:
        return _procedure_of(reader.info.procedure)
    except BadInput as error:
        raise BadInput(error.problem, f"procedure in {reader.path}", error.place) from None


def recorded_registration(reader: RunReader) -> BaseRegistration:
    """Return the registration of a recorded run.

    Raises:
        BadInput: If it is not valid.
    """
    try:
        return _registration_of(reader.info.registration)
    except BadInput as error:
        raise BadInput(error.problem, f"registration in {reader.path}", error.place) from None


def _procedure(reader: RunReader, given: str | Procedure | None) -> Procedure:
    if isinstance(given, Procedure):
        return given
    return assemble.load_procedure(given) if given else recorded_procedure(reader)


@lru_cache(maxsize=8)
def _procedure_of(text: str) -> Procedure:
    """Parse a procedure; the recordings of an archive have only a few."""
    return assemble.parse_procedure(text, "procedure")


@lru_cache(maxsize=8)
def _registration_of(text: str) -> BaseRegistration:
    return parse_registration(text, "registration")


def _notes(reader: RunReader, procedure: Procedure) -> tuple[str, ...]:
    info = reader.info
    played = f"the device played amplitudes by its profile, sha256 {info.device_profile_sha256[:12]}"
    notes: tuple[str, ...] = (played,) if info.device_profile else ()
    if info.version != __version__:
        notes += (
            f"recorded by haptigraph {info.version}, replayed by {__version__}: "
            "steps also differ where perception has changed since",
        )
    name = assemble.perceiver_name(recorded_config(reader), procedure)
    if is_own(name):
        notes += (own_note(reader, name),)
    elif name not in assemble.PERCEIVERS:
        return notes
    return (*notes, *unreported_notes(procedure, name, assemble.perceiver_class))


def own_note(reader: RunReader, perceiver: str) -> str:
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


def _count(report: ReplayReport, time_s: float, recorded: Step, replayed: Step) -> None:
    """Count a step by what differs in it."""
    states = recorded.conclusion.state, replayed.conclusion.state
    before, after = recorded.command.pattern, replayed.command.pattern
    report.states.add(report.steps, time_s, *states, is_other=states[0] != states[1])
    report.haptics.add(report.steps, time_s, before.name, after.name, is_other=before != after)
    report.recorded_patterns[before.name] += 1
    report.replayed_patterns[after.name] += 1


def _differing(recorded: Step, replayed: Step) -> tuple[str, bytes, bytes] | None:
    """Return the first message that differs, as recorded and as replayed; None: the steps are identical."""
    for message in COMPARED:
        before, after = (msgspec.json.encode(getattr(step, message)) for step in (recorded, replayed))
        if before != after:
            return message, before, after
    return None


def _numbers_differ_by(recorded: Step, replayed: Step) -> float | None:
    """Return by how much the numbers of two steps differ at most; None: something else differs."""
    found = [
        largest_difference(*(msgspec.to_builtins(getattr(step, message)) for step in (recorded, replayed)))
        for message in COMPARED
    ]
    numbers = [each for each in found if each is not None]
    return max(numbers) if len(numbers) == len(COMPARED) else None
