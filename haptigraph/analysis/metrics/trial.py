"""All measures of one trial, from its steps or its recording, by the names of the study's data dictionary.

Measured over exactly the run: from the tip's first being inside the globe to the first Target Hit, or to the
trial's end if there was none. What cannot be told is left out. Formulas that do not stand
here stand in `measures` and `motion`.
"""

from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.analysis.metrics.motion import (
    band_power,
    log_dimensionless_jerk,
    low_passed,
    path_length,
    sparc,
    speed,
)
from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.assemble import parse_procedure
from haptigraph.errors import BadInput
from haptigraph.geometry import Point
from haptigraph.graph import Triplet
from haptigraph.haptics.pattern import amplitude_at, next_change_ns
from haptigraph.inference.span import RunSpan
from haptigraph.messages import HapticCommand, Step
from haptigraph.recording.reader import RunReader

__all__ = ["measure_recording", "measure_trial"]

Floats = NDArray[np.float64]
NEAR = (
    Triplet("needle_tip", "approaching", "retina_surface"),
    Triplet("needle_tip", "touching", "retina_surface"),
)
BRIDGED_S = 0.5
"""Gaps up to this are bridged by a straight line; longer ones break a movement in two."""
SHORTEST = 4
"""Samples that make a movement."""
REACTION_DEG_S = 1.0
"""Theta falls when it does so at least this fast ..."""
LASTING_S = 0.1
"""... for so long."""
EARLIEST_S, LATEST_S = 0.1, 2.0
"""What comes sooner after a cue was under way before it; what comes later is taken for something else."""


class _Sample(Struct, frozen=True):
    """What is needed of one step of the run."""

    time_s: float
    tip_mm: tuple[float, float] | None
    theta_deg: float
    retina_mm: float
    near: bool
    command: HapticCommand


class _Movement(Struct, frozen=True):
    """A stretch in which the tip was seen, evenly sampled and low-passed but for `raw_mm`."""

    rate_hz: float
    time_s: Floats
    raw_mm: Floats
    tip_mm: Floats
    theta_deg: Floats
    retina_mm: Floats
    near: NDArray[np.bool_]


def measure_recording(path: str | Path) -> dict[str, float | int | str]:
    """Measure a recorded trial.

    Raises:
        BadInput: If it cannot be read, or was interrupted.
    """
    reader = RunReader(path)
    if not reader.is_whole:
        raise BadInput("was interrupted, so it is no trial; `haptigraph recover` makes it whole", path)
    procedure = parse_procedure(reader.info.procedure, f"procedure in {path}")
    config: dict[str, Any] = msgspec.json.decode(reader.info.config)
    touch = config.get("haptics", {}).get("max_amplitude", 1.0) > 0
    steps = (step for _, step in reader.records(images=()))
    return measure_trial(steps, [state.name for state in procedure.states], touch=touch, span=procedure.span)


def measure_trial(
    steps: Iterable[Step], states: Iterable[str] = (), *, touch: bool = True, span: RunSpan | None = None
) -> dict[str, float | int | str]:
    """Measure a trial.

    Args:
        steps: All of it, in order.
        states: Of the procedure; the time in one that did not occur is 0.
        touch: Whether the hand felt anything at all.
        span: From where to where it is measured; as in the paper if not given.

    Returns:
        Measures by name; empty if what begins a run was never there.
    """
    run, samples = RunMeasures(span=span or RunSpan()), list[_Sample]()
    for step in steps:
        over = run.ended_ns is not None
        run.add(step)
        if run.started_ns is not None and not over:
            samples.append(_sample(step))
    if not samples:
        return {}
    movements = list(_movements(samples))
    measures: dict[str, float | int | str | None] = {
        "completion_s": run.completion_s,
        "mean_theta_deg": run.mean_theta_deg,
        "contacts": run.contacts,
        "state_order": ">".join(run.order),
        "vibrating_s": _vibrating_s(samples) if touch else 0.0,
        "reaction_ms": _reaction_ms(samples, movements),
        **_motion(movements),
    }
    measures |= {
        f"time_{state}_s": run.state_s.get(state, 0.0) for state in dict.fromkeys([*states, *run.state_s])
    }
    return {name: value for name, value in measures.items() if value is not None}


def _sample(step: Step) -> _Sample:
    tip = step.observation.found.get("needle_tip")
    measures = step.graph.measures
    return _Sample(
        time_s=step.stamp_ns / 1e9,
        tip_mm=tip.at_mm if isinstance(tip, Point) else None,
        theta_deg=measures.get("theta_deg", np.nan),
        retina_mm=measures.get("distance_to_retina_mm", np.nan),
        near=any(edge in step.graph for edge in NEAR),
        command=step.command,
    )


def _movements(samples: list[_Sample]) -> Iterator[_Movement]:
    """Cut a run where the tip was long unseen, and sample each piece evenly, at the run's median rate."""
    seen = [sample for sample in samples if sample.tip_mm is not None]
    times_s = np.array([sample.time_s for sample in samples])
    if len(seen) < SHORTEST:
        return
    rate_hz = 1 / float(np.median(np.diff(times_s)))
    cuts = np.flatnonzero(np.diff([sample.time_s for sample in seen]) > BRIDGED_S) + 1
    for start, end in zip([0, *cuts], [*cuts, len(seen)], strict=True):
        if end - start >= SHORTEST:
            yield _movement(seen[start:end], rate_hz)


def _movement(seen: list[_Sample], rate_hz: float) -> _Movement:
    time_s = np.array([sample.time_s for sample in seen])
    even_s = np.arange(time_s[0], time_s[-1] + 0.5 / rate_hz, 1 / rate_hz)

    def even(values: list[float]) -> Floats:
        found: Floats = np.interp(even_s, time_s, values)
        return found

    raw_mm = np.column_stack(
        [even([sample.tip_mm[axis] for sample in seen if sample.tip_mm]) for axis in (0, 1)]
    )
    return _Movement(
        rate_hz=rate_hz,
        time_s=even_s,
        raw_mm=raw_mm,
        tip_mm=low_passed(raw_mm, rate_hz),
        theta_deg=low_passed(even([sample.theta_deg for sample in seen]), rate_hz),
        retina_mm=low_passed(even([sample.retina_mm for sample in seen]), rate_hz),
        near=even([float(sample.near) for sample in seen]) > 0.5,
    )


def _motion(movements: list[_Movement]) -> dict[str, float | None]:
    """Return path, smoothness, tremor and speed of approach.

    Path and tremor are those of all stretches; smoothness is that of one movement, so there is none where the
    tip was long unseen. Speed of approach is the greatest -d(distance to the retina)/dt while the tip is
    approaching or touching it, by the procedure's own relations; at least 0.
    """
    whole = movements[0] if len(movements) == 1 else None
    speeds = speed(whole.tip_mm, whole.rate_hz) if whole else np.empty(0)
    powers = [(band_power(each.raw_mm, each.rate_hz), len(each.time_s)) for each in movements]
    known = [(power, count) for power, count in powers if power is not None]
    towards = [
        (-np.gradient(each.retina_mm, 1 / each.rate_hz)[each.near]).max(initial=0.0)
        for each in movements
        if each.near.any() and np.isfinite(each.retina_mm).all()
    ]
    return {
        "path_mm": sum(path_length(each.tip_mm) for each in movements) if movements else None,
        "sparc": sparc(speeds, whole.rate_hz) if whole else None,
        "log_jerk": log_dimensionless_jerk(speeds, whole.rate_hz) if whole else None,
        "tremor_power_mm2": sum(p * n for p, n in known) / sum(n for _, n in known) if known else None,
        "approach_speed_mm_s": float(max(towards)) if towards else None,
    }


def _vibrating_s(samples: list[_Sample]) -> float:
    """Return for how long an amplitude above 0 was commanded; the guard may have let through less."""
    total_ns = 0
    for sample, after in pairwise(samples):
        at_ns: int | None = sample.command.stamp_ns
        end_ns = after.command.stamp_ns
        while at_ns is not None and at_ns < end_ns:
            until_ns = next_change_ns(sample.command, at_ns)
            until_ns = end_ns if until_ns is None else min(until_ns, end_ns)
            total_ns += (until_ns - at_ns) * (amplitude_at(sample.command, at_ns) > 0)
            at_ns = until_ns
    return total_ns / 1e9


def _reaction_ms(samples: list[_Sample], movements: list[_Movement]) -> float | None:
    """Return the median time from a cue to the beginning of its correction.

    A cue is a lasting vibration's onset out of silence, as the procedure commands it; where touch is off it
    is the moment at which it would have begun, so that conditions compare. The correction begins when theta
    falls by 1 deg/s or more for 0.1 s (a threshold on velocity, as is usual for movements' onsets). Left
    out are cues at which theta was falling already or fell within 0.1 s, faster than people react (the limit
    for false starts in athletics), and those without a fall within 2 s.
    """
    reactions_s = []
    for before, sample in pairwise(samples):
        if before.command.pattern.kind == "off" and sample.command.pattern.kind == "continuous":
            movement = next((m for m in movements if m.time_s[0] <= sample.time_s <= m.time_s[-1]), None)
            reaction_s = _reaction_s(movement, sample.time_s) if movement else None
            if reaction_s is not None:
                reactions_s.append(reaction_s)
    return 1000 * float(np.median(reactions_s)) if reactions_s else None


def _reaction_s(movement: _Movement, cue_s: float) -> float | None:
    falls = np.gradient(movement.theta_deg, 1 / movement.rate_hz) <= -REACTION_DEG_S
    lasting = max(1, round(LASTING_S * movement.rate_hz))
    first = int(np.searchsorted(movement.time_s, cue_s))
    for place in range(first, len(falls) - lasting + 1):
        since_s = float(movement.time_s[place]) - cue_s
        if since_s > LATEST_S:
            return None
        if falls[place : place + lasting].all():
            return since_s if since_s >= EARLIEST_S else None
    return None
