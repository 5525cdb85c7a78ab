"""How each counted run went, from its recording: theta and distance over normalised time."""

import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.assemble import parse_procedure
from haptigraph.errors import BadInput
from haptigraph.graph import Schema
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress

__all__ = ["GRID", "Trace", "Traces", "Zones", "read_traces"]

GRID = np.linspace(0.0, 1.0, 201)
"""Normalised time: 0 where the run starts, 1 at the hit."""
Floats = NDArray[np.float64]


class Trace(Struct, frozen=True):
    """One run that ended in a hit, on `GRID`; where the needle was not seen, between its neighbours."""

    participant: str
    condition: str
    theta_deg: Floats
    distance_mm: Floats
    """To the retina, signed."""


class Zones(Struct, frozen=True):
    """Where the procedure draws its lines; None: it draws none."""

    aligned_deg: float | None
    touching_mm: float | None
    approaching_mm: float | None

    @classmethod
    def under(cls, schema: Schema) -> "Zones":
        """Return the bounds that a procedure sets."""
        bounds = {relation.names: relation.at_most for relation in schema.relations}
        return cls(
            bounds.get(("needle_line", "aligned", "retina_target")),
            bounds.get(("needle_tip", "touching", "retina_surface")),
            bounds.get(("needle_tip", "approaching", "retina_surface")),
        )


class Traces(Struct, frozen=True):
    """All runs that could be read."""

    runs: list[Trace]
    zones: Zones
    absent: int
    """Counted runs without a recording in the folder."""
    is_simulated: bool
    """Whether a source was the phantom with its simulated operator."""

    def of(self, condition: str) -> list[Trace]:
        """Return the runs of one condition."""
        return [run for run in self.runs if run.condition == condition]

    def by_participant(self, condition: str, what: str) -> Floats:
        """Return the mean run of each participant, (participants, len(GRID)).

        Args:
            condition: Which one.
            what: `theta_deg` or `distance_mm`.
        """
        runs = self.of(condition)
        names = sorted({run.participant for run in runs})
        means = [
            np.mean([getattr(run, what) for run in runs if run.participant == name], axis=0) for name in names
        ]
        return np.array(means, np.float64).reshape(-1, len(GRID))


def read_traces(runs: pd.DataFrame, folder: Path, progress: Progress | None = None) -> Traces:
    """Read the recordings of the runs that count and ended in a hit.

    Args:
        runs: That count.
        folder: What the paths in `recording` are relative to.
        progress: Told how many are read.

    Raises:
        BadInput: If a recording is not the one that the table tells of, or cannot be read.
    """
    report = progress or (lambda what, done, total: None)
    traces, absent, zones, simulated = [], 0, set(), False
    for done, row in enumerate(_rows(runs)):
        report("reading recordings", done, len(runs))
        path = folder / str(row.get("recording") or "")
        if not path.is_file():
            absent += 1
            continue
        _check(path, row.get("recording_sha256"))
        reader = RunReader(path)
        simulated |= reader.info.source.startswith("phantom:")
        schema = parse_procedure(reader.info.procedure, f"procedure in {path}").schema
        trace = _trace(reader, row)
        if trace is not None:
            zones.add(Zones.under(schema))
            traces.append(trace)
    report("reading recordings", len(runs), len(runs))
    return Traces(traces, zones.pop() if len(zones) == 1 else Zones(None, None, None), absent, simulated)


def _rows(runs: pd.DataFrame) -> Iterator[dict[str, object]]:
    hits = runs[runs["outcome"] == "hit"]
    for row in hits.to_dict("records"):
        yield {name: value for name, value in row.items() if isinstance(value, str)}


def _check(path: Path, expected: object) -> None:
    found = hashlib.sha256(path.read_bytes()).hexdigest()
    if expected and found != expected:
        raise BadInput(
            f"is not this trial's recording (SHA-256 {found[:12]}..., in trials {str(expected)[:12]}...)",
            path,
        )


def _trace(reader: RunReader, row: dict[str, object]) -> Trace | None:
    """Return the run between its start and its hit."""
    procedure = parse_procedure(reader.info.procedure, f"procedure of {row['participant']}")
    measures, rows = RunMeasures(span=procedure.span), []
    for _, step in reader.records(images=()):
        measures.add(step)
        if measures.started_ns is not None:
            told = step.graph.measures
            rows.append(
                (step.stamp_ns, told.get("theta_deg", np.nan), told.get("distance_to_retina_mm", np.nan))
            )
        if measures.ended_ns is not None:
            break
    if measures.ended_ns is None or measures.ended_ns == measures.started_ns:
        return None
    stamp_ns, theta_deg, distance_mm = np.array(rows, np.float64).T
    time = (stamp_ns - stamp_ns[0]) / (stamp_ns[-1] - stamp_ns[0])
    columns = [_on_grid(time, column) for column in (theta_deg, distance_mm)]
    return Trace(str(row["participant"]), str(row["condition"]), *columns)


def _on_grid(time: Floats, values: Floats) -> Floats:
    known = np.isfinite(values)
    return np.interp(GRID, time[known], values[known]) if known.any() else np.full(len(GRID), np.nan)
