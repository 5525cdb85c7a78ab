"""The columns of an exported run, one row a step: name, kind, unit and meaning, and the value in each step.

CSV, Parquet, MCAP and LeRobot are written from them, and their data dictionaries too. What is unknown or was
not recorded is None, never 0.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

from haptigraph.assemble import parse_procedure
from haptigraph.errors import BadInput
from haptigraph.geometry import Point, Segment
from haptigraph.haptics.pattern import amplitude_at
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Capture, Step, Truth
from haptigraph.recording.reader import RunReader
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.registered import BaseRegistration
from haptigraph.scene.meanings import meanings_in

__all__ = ["Column", "Row", "RunTable", "certainty_columns", "measure_columns", "sd_name", "unit_of"]

Group: TypeAlias = Literal[
    "run",
    "time",
    "state",
    "haptics",
    "measures",
    "needle",
    "scene",
    "robot",
    "hand",
    "action",
    "force",
    "truth",
]
Kind: TypeAlias = Literal["text", "integer", "number", "texts"]
SYMBOLS = {"um": "µm", "percent": "%", "hz": "Hz", "n": "N", "utc": "UTC"}
UNITS = {unit: unit for unit in ("mm", "deg", "ns", "s")} | SYMBOLS
STAGES = ("perceive", "build_scene", "reason", "render")
XYZ, XYZW = ("x", "y", "z"), ("x", "y", "z", "w")


class Row(NamedTuple):
    """One step, with what the values of its columns depend on."""

    number: int
    """Of the step in the recording."""
    capture: Capture
    step: Step
    start_ns: int
    """When the first step was captured."""


Value: TypeAlias = Callable[[Row], Any]


class Column(NamedTuple):
    """One column."""

    name: str
    kind: Kind
    group: Group
    meaning: str
    value: Value
    """None where there is none."""

    @property
    def unit(self) -> str:
        """The unit, from the name; empty: none."""
        return unit_of(self.name)


def unit_of(name: str) -> str:
    """Return the unit in the last part of a name ("theta_deg"); empty: none."""
    return UNITS.get(name.rpartition("_")[2], "")


def sd_name(measure: str) -> str:
    """Return the name of the column with a measure's standard deviation: "theta_sd_deg" of "theta_deg"."""
    stem, _, unit = measure.rpartition("_")
    return f"{stem}_sd_{unit}"


class RunTable:
    """One recording as a table.

    Args:
        path: The recording.
        name: What the column `recording` says.

    Raises:
        BadInput: If it cannot be read.
    """

    def __init__(self, path: str | Path, name: str) -> None:
        self.reader = RunReader(path)
        self.procedure = parse_procedure(self.reader.info.procedure, f"procedure in {path}")
        self.registration: BaseRegistration = parse_registration(
            self.reader.info.registration, f"registration in {path}"
        )
        self.columns = tuple(
            _columns(self.procedure, self.registration, name, self.reader.info.utc_offset_ns)
        )

    def rows(self, *, images: bool = False) -> Iterator[Row]:
        """Yield the steps.

        Args:
            images: Whether images are decoded.

        Raises:
            BadInput: If the recording is damaged, or has no complete step.
        """
        start_ns = None
        for number, capture, step in self.reader.numbered_records(images=None if images else ()):
            start_ns = step.stamp_ns if start_ns is None else start_ns
            yield Row(number, capture, step, start_ns)
        if start_ns is None:
            raise BadInput("has no complete step to export", self.reader.path)


def _columns(
    procedure: Procedure, registration: BaseRegistration, name: str, utc_offset_ns: int
) -> Iterator[Column]:
    yield from _about_the_step(name, utc_offset_ns)
    yield from _decisions()
    yield from measure_columns(meanings_in(procedure.schema))
    yield from _needle(procedure, registration)
    yield from _scene()
    yield from _motion()
    yield from _timing()
    yield from _truth()


def _about_the_step(name: str, utc_offset_ns: int) -> Iterator[Column]:
    def utc(row: Row) -> datetime:
        stamp_s, rest_ns = divmod(row.step.stamp_ns + utc_offset_ns, 1_000_000_000)
        return datetime.fromtimestamp(stamp_s, UTC).replace(microsecond=rest_ns // 1000)

    yield Column("recording", "text", "run", "the recording", lambda row: name)
    yield Column("step", "integer", "run", "number of the step in the recording", lambda row: row.number)
    yield Column(
        "image", "integer", "run", "number of the image in its source; repeated where there was no new one",
        lambda row: row.step.index,
    )  # fmt: skip
    yield Column(
        "time_s", "number", "time", "time since the first step",
        lambda row: (row.step.stamp_ns - row.start_ns) / 1e9,
    )  # fmt: skip
    yield Column(
        "stamp_ns", "integer", "time", "when the image was captured, on the run's clock",
        lambda row: row.step.stamp_ns,
    )  # fmt: skip
    yield Column("utc", "text", "time", "when the image was captured, wall clock", utc)


def _decisions() -> Iterator[Column]:
    yield Column("state", "text", "state", "the surgical state", lambda row: row.step.conclusion.state)
    yield Column(
        "feels", "text", "haptics", "the pattern that the state requests",
        lambda row: row.step.conclusion.feel,
    )  # fmt: skip
    yield Column(
        "plays", "text", "haptics", "the pattern commanded", lambda row: row.step.command.pattern.name
    )
    yield Column(
        "amplitude", "number", "haptics", "commanded at the image's time, 0 to 1; max_amplitude may limit it",
        lambda row: amplitude_at(row.step.command, row.step.stamp_ns),
    )  # fmt: skip
    yield Column(
        "frequency_hz", "number", "haptics", "vibration frequency of the pattern commanded",
        lambda row: row.step.command.pattern.frequency_hz or None,
    )  # fmt: skip
    yield Column(
        "since_ns", "integer", "haptics", "when the pattern began, on the run's clock",
        lambda row: row.step.command.since_ns,
    )  # fmt: skip
    yield Column(
        "forces", "texts", "haptics", "the force fields that act",
        lambda row: [field.name for field in row.step.command.forces],
    )  # fmt: skip


def measure_columns(meanings: Mapping[str, str]) -> Iterator[Column]:
    """Yield the columns of measures, by name, each with that of its standard deviation."""
    for name, meaning in meanings.items():
        yield Column(name, "number", "measures", meaning, _measure(name))
        yield Column(
            sd_name(name), "number", "measures",
            f"standard deviation of {name}, where a relation of the procedure has a margin", _sd(name),
        )  # fmt: skip


def _measure(name: str) -> Value:
    return lambda row: row.step.graph.measures.get(name)


def _sd(name: str) -> Value:
    return lambda row: row.step.graph.sds.get(name)


def _needle(procedure: Procedure, registration: BaseRegistration) -> Iterator[Column]:
    axes = XYZ if registration.image.slices else XYZ[:2]
    moving = [entity for entity in procedure.schema.entities if entity.name not in registration.anatomy]
    for entity in moving:
        ends = {"point": ("",), "segment": ("start_", "end_")}.get(entity.geometry, ())
        for end in ends:
            for axis in axes:
                what = f"{end.rstrip('_')} of {entity.name}" if end else entity.name
                yield Column(
                    f"{entity.name}_{end}{axis}_mm", "number", "needle", f"{axis} of {what}, eye frame",
                    _coordinate(entity.name, end, XYZ.index(axis)),
                )  # fmt: skip
    yield from certainty_columns()


def certainty_columns() -> Iterator[Column]:
    """Yield the columns of what a perceiver says of its needle."""
    for name, meaning, field in (
        ("needle_confidence", "fraction of the visible shaft whose edges support one line", "confidence"),
        ("needle_tip_sd_mm", "standard deviation of the tip, per axis", "tip_sd_mm"),
        ("needle_line_sd_deg", "standard deviation of the shaft's angle", "theta_sd_deg"),
    ):
        yield Column(name, "number", "needle", meaning, _of_certainty(field))


def _coordinate(name: str, end: str, axis: int) -> Value:
    def value(row: Row) -> float | None:
        shape = row.step.observation.found.get(name)
        if isinstance(shape, Point):
            return (*shape.at_mm, shape.z_mm)[axis]
        if isinstance(shape, Segment):
            start = (*shape.start_mm, shape.start_z_mm)
            return (start if end == "start_" else (*shape.end_mm, shape.end_z_mm))[axis]
        return None

    return value


def _of_certainty(field: str) -> Value:
    return lambda row: getattr(row.step.observation.certainty, field, None)


def _scene() -> Iterator[Column]:
    yield Column(
        "relations", "texts", "scene", "the edges of the scene graph: <subject, predicate, object>",
        lambda row: [str(edge) for edge in row.step.graph.edges],
    )  # fmt: skip
    yield Column(
        "faults", "texts", "scene", "faults in this step: where, and what",
        lambda row: [*map(str, row.step.faults)],
    )  # fmt: skip
    yield Column("because", "text", "scene", "why the state", lambda row: row.step.conclusion.because)
    yield Column(
        "phase", "text", "scene", "phase of the operation, as a person or a script set it",
        lambda row: row.capture.phase or None,
    )  # fmt: skip


def _motion() -> Iterator[Column]:
    """Yield what moved the instrument and the hand; of several samples in a step, the newest."""
    parts: tuple[tuple[Group, str, str, str, Sequence[str], str, str], ...] = (
        ("robot", "robot", "robot", "position_mm", XYZ, "mm", "the tip in the robot's base"),
        ("robot", "robot_rotation", "robot", "quaternion", XYZW, "", "rotation, tool to the robot's base"),
        ("force", "hand", "force", "hand_mm", XYZ, "mm", "the hand on the force device"),
        ("force", "hand_force", "force", "force_n", XYZ, "n", "force commanded on the hand"),
    )
    for group, stem, samples, field, axes, unit, meaning in parts:
        for index, axis in enumerate(axes):
            name = f"{stem}_{axis}" + (f"_{unit}" if unit else "")
            value = _newest(samples, field, index)
            yield Column(name, "number", group, f"{axis} of {meaning}; the newest sample", value)
    motions: tuple[tuple[Group, str, str], ...] = (
        ("hand", "along_mm", "motion of the operator's hand into the eye since the previous image"),
        ("hand", "across_mm", "motion of the operator's hand to the right since the previous image"),
        ("action", "asked_along_mm", "motion requested of the tool into the eye since the previous image"),
        ("action", "asked_across_mm", "motion requested of the tool to the right since the previous image"),
    )
    for group, name, meaning in motions:
        yield Column(name if group == "action" else f"hand_{name}", "number", group, meaning, _of_hand(name))


def _newest(samples: str, field: str, index: int) -> Value:
    def value(row: Row) -> float | None:
        found = getattr(row.capture, samples)
        return getattr(found[-1], field)[index] if found else None

    return value


def _of_hand(field: str) -> Value:
    return lambda row: getattr(row.capture.hand, field, None)


def _timing() -> Iterator[Column]:
    for name, meaning in (
        ("processed_ns", "when the conclusion was reached, on the run's clock"),
        ("commanded_ns", "when the command was passed to the device, on the run's clock"),
    ):
        yield Column(name, "integer", "time", meaning, _of_timing(name))
    for stage in STAGES:
        yield Column(f"{stage}_ns", "integer", "time", f"duration of the stage {stage}", _of_stage(stage))


def _of_timing(field: str) -> Value:
    return lambda row: getattr(row.step.timing, field, None)


def _of_stage(stage: str) -> Value:
    return lambda row: row.step.timing.stage_ns.get(stage) if row.step.timing else None


def _truth() -> Iterator[Column]:
    of_truth: tuple[tuple[str, Kind, str, Callable[[Truth], Any]], ...] = (
        ("tip_visible", "integer", "whether the tip is visible: 1 or 0", lambda truth: int(truth.visible)),
        ("tip_x_mm", "number", "x of the tip, eye frame", lambda truth: truth.tip_mm[0]),
        ("tip_y_mm", "number", "y of the tip, eye frame", lambda truth: truth.tip_mm[1]),
        ("depth_mm", "number", "depth of the tip", lambda truth: truth.depth_mm),
        ("theta_deg", "number", "angle of the shaft", lambda truth: truth.theta_deg),
    )
    for name, kind, meaning, value in of_truth:
        meaning = f"the simulator's ground truth: {meaning}"
        yield Column(f"true_{name}", kind, "truth", meaning, _of_truth(value))


def _of_truth(value: Callable[[Truth], Any]) -> Value:
    return lambda row: None if row.capture.truth is None else value(row.capture.truth)
