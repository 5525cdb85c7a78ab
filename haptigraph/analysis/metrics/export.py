"""Export a recorded run as a CSV table for other programs: one row per step."""

import csv
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from haptigraph.assemble import parse_procedure
from haptigraph.errors import BadInput
from haptigraph.geometry import Point
from haptigraph.haptics.pattern import amplitude_at
from haptigraph.messages import Step
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress
from haptigraph.registration.loading import parse_registration

__all__ = ["run_csv"]


def run_csv(path: str | Path, output: str | Path, progress: Progress | None = None) -> None:
    """Write one recorded run as CSV; docs/recordings.md lists the columns.

    Args:
        path: The recording.
        output: The file to write; replaced if it exists.
        progress: Called with the number of steps written.

    Raises:
        BadInput: If the recording cannot be read or the file cannot be written.
    """
    reader = RunReader(path)
    schema = parse_procedure(reader.info.procedure, f"procedure in {path}").schema
    anatomy = parse_registration(reader.info.registration, f"registration in {path}").anatomy
    measures = list(schema.measure_names)
    points = [
        entity.name for entity in schema.entities if entity.geometry == "point" and entity.name not in anatomy
    ]
    try:
        with open(output, "w", newline="", encoding="utf-8") as file:
            table = csv.writer(file)
            table.writerow(_header(measures, points))
            for number, row in enumerate(_rows(reader, measures, points)):
                table.writerow(row)
                if progress is not None:
                    progress("writing", number + 1, 0)
    except OSError as error:  # that of a full disk does not name the file
        raise BadInput(f"cannot be written ({error.strerror})", output) from None


def _header(measures: list[str], points: list[str]) -> list[str]:
    coordinates = [f"{name}_{axis}_mm" for name in points for axis in "xy"]
    return [
        *("step", "image", "time_s", "stamp_ns", "utc", "state", "feels", "plays", "amplitude"),
        *measures,
        *coordinates,
        *("relations", "faults", "because"),
    ]


def _rows(reader: RunReader, measures: list[str], points: list[str]) -> Iterator[list[object]]:
    start_ns = None
    for place, step in reader.places():
        start_ns = step.stamp_ns if start_ns is None else start_ns
        utc = datetime.fromtimestamp((step.stamp_ns + reader.info.utc_offset_ns) / 1e9, UTC)
        yield [
            place.sequence,
            step.index,
            (step.stamp_ns - start_ns) / 1e9,
            step.stamp_ns,
            utc.isoformat(timespec="milliseconds"),
            step.conclusion.state,
            step.conclusion.feel,
            step.command.pattern.name,
            amplitude_at(step.command, step.stamp_ns),
            *(step.graph.measures.get(name, "") for name in measures),
            *_coordinates(step, points),
            "; ".join(str(edge) for edge in step.graph.edges),
            "; ".join(f"{fault.where}: {fault.message}" for fault in step.faults),
            step.conclusion.because,
        ]


def _coordinates(step: Step, points: list[str]) -> Iterator[object]:
    for name in points:
        shape = step.observation.found.get(name)
        yield from shape.at_mm if isinstance(shape, Point) else ("", "")
