"""Traces of the analysed runs, from their recordings: theta and distance over normalised time."""

import warnings
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.assemble import parse_procedure
from haptigraph.checksum import sha256_of
from haptigraph.errors import BadInput, RenamedKey
from haptigraph.graph import Schema
from haptigraph.inference.span import RunSpan
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress

__all__ = ["GRID", "Floats", "Trace", "Traces", "Zones", "read_traces"]

GRID = np.linspace(0.0, 1.0, 201)
"""Normalised time: 0 at the start of the run, 1 at its end."""
Floats = NDArray[np.float64]
TRACED = ("theta_deg", "distance_to_retina_mm")


class Trace(Struct, frozen=True):
    """One run, on `GRID`; interpolated where the needle was not detected."""

    run: int
    """Its row in the analysed runs."""
    participant: str
    condition: str
    is_hit: bool
    duration_s: float
    theta_deg: Floats
    distance_mm: Floats
    """To the retina, signed."""
    states: list[tuple[float, str]]
    """When each state was entered, in seconds from the start."""


class Zones(Struct, frozen=True):
    """The thresholds of a procedure; None: it has no such threshold."""

    aligned_deg: float | None
    touching_mm: float | None
    approaching_mm: float | None

    @classmethod
    def under(cls, schema: Schema) -> "Zones":
        """Return the thresholds of a procedure's schema."""
        bounds = {relation.names: relation.at_most for relation in schema.relations}
        return cls(
            bounds.get(("needle_line", "aligned", "retina_target")),
            bounds.get(("needle_tip", "touching", "retina_surface")),
            bounds.get(("needle_tip", "approaching", "retina_surface")),
        )


class Traces(Struct, frozen=True):
    """The traces of all runs with a recording."""

    runs: list[Trace]
    zones: Zones
    absent: int
    """Number of analysed runs without a recording in the folder."""
    is_simulated: bool
    """Whether any source was the phantom with its simulated operator."""

    @property
    def hits(self) -> list[Trace]:
        """Runs that ended in a hit, which alone have a common scale of normalised time."""
        return [run for run in self.runs if run.is_hit]

    def of(self, condition: str) -> list[Trace]:
        """Return the runs of one condition that ended in a hit."""
        return [run for run in self.hits if run.condition == condition]

    def by_participant(self, condition: str, what: str) -> Floats:
        """Return the mean trace of each participant's hits, (participants, len(GRID)).

        Args:
            condition: The condition.
            what: `theta_deg` or `distance_mm`.
        """
        runs = self.of(condition)
        names = sorted({run.participant for run in runs})
        means = [
            np.mean([getattr(run, what) for run in runs if run.participant == name], axis=0) for name in names
        ]
        return np.array(means, np.float64).reshape(-1, len(GRID))


def read_traces(runs: pd.DataFrame, folder: Path, progress: Progress | None = None) -> Traces:
    """Read the recordings of the analysed runs.

    Args:
        runs: The analysed runs.
        folder: The folder to which the paths in `recording` are relative.
        progress: Called with the number of recordings read.

    Raises:
        BadInput: If the SHA-256 of a recording differs from the table's, or it cannot be read.
    """
    report = progress or (lambda what, done, total: None)
    traces, absent, zones, simulated = [], 0, set(), False
    for done, row in enumerate(runs.reset_index(drop=True).to_dict("records")):
        report("reading recordings", done, len(runs))
        path = folder / name if isinstance(name := row.get("recording"), str) else folder
        if not path.is_file():
            absent += 1
            continue
        _check(path, row.get("recording_sha256"))
        reader = RunReader(path)
        simulated |= reader.info.source.partition(":")[0] == "phantom"
        with warnings.catch_warnings(action="ignore", category=RenamedKey):
            procedure = parse_procedure(reader.info.procedure, f"procedure in {path}")
        trace = _trace(reader, done, row, procedure.span)
        if trace is not None:
            zones.add(Zones.under(procedure.schema))
            traces.append(trace)
    report("reading recordings", len(runs), len(runs))
    return Traces(traces, zones.pop() if len(zones) == 1 else Zones(None, None, None), absent, simulated)


def _check(path: Path, expected: object) -> None:
    found = sha256_of(path)
    if isinstance(expected, str) and found != expected:
        digests = f"SHA-256 {found[:12]}..., in trials {str(expected)[:12]}..."
        raise BadInput(f"is not the recording of this trial ({digests})", path)


def _trace(reader: RunReader, run: int, row: dict[Hashable, Any], span: RunSpan) -> Trace | None:
    """Return the run from its start to its hit, or to the end of the recording."""
    measures, rows, states = RunMeasures(span=span), [], list[tuple[int, str]]()
    for _, step in reader.records(images=()):
        measures.add(step)
        if measures.started_ns is not None:
            rows.append((step.stamp_ns, *(step.graph.measures.get(name, np.nan) for name in TRACED)))
            if not states or states[-1][1] != step.conclusion.state:
                states.append((step.stamp_ns, step.conclusion.state))
        if measures.ended_ns is not None:
            break
    is_hit = row["outcome"] == "hit"
    if measures.started_ns is None or len(rows) < 2 or is_hit != (measures.ended_ns is not None):
        return None
    stamp_ns, theta_deg, distance_mm = np.array(rows, np.float64).T
    time = (stamp_ns - stamp_ns[0]) / (stamp_ns[-1] - stamp_ns[0])
    entered = [((since_ns - measures.started_ns) / 1e9, state) for since_ns, state in states]
    duration_s = float(stamp_ns[-1] - stamp_ns[0]) / 1e9
    return Trace(
        run=run,
        participant=str(row["participant"]),
        condition=str(row["condition"]),
        is_hit=is_hit,
        duration_s=duration_s,
        theta_deg=_on_grid(time, theta_deg),
        distance_mm=_on_grid(time, distance_mm),
        states=entered,
    )


def _on_grid(time: Floats, values: Floats) -> Floats:
    valid = np.isfinite(values)
    return np.interp(GRID, time[valid], values[valid]) if valid.any() else np.full(len(GRID), np.nan)
