"""All measures of one trial, from its steps or its recording, by the names of the study's data dictionary.

They cover exactly the run: from the tip's first entry into the globe to the first Target Hit, or to the end
of the trial if there was none. Measures that cannot be determined are omitted. `run` and `motion` have the
formulas that are not documented here.
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
NEAR_RETINA = (
    Triplet("needle_tip", "approaching", "retina_surface"),
    Triplet("needle_tip", "touching", "retina_surface"),
)
MAX_GAP_S = 0.5
"""Shorter gaps are interpolated linearly; longer ones split a movement in two."""
MIN_SAMPLES = 4
"""Of a movement."""
MIN_FALL_DEG_S = 1.0
"""A correction reduces theta at least this fast ..."""
MIN_FALL_S = 0.1
"""... for this long."""
MIN_REACTION_S, MAX_REACTION_S = 0.1, 2.0
"""An earlier correction began before the cue; a later one is not attributed to it."""


class _Sample(Struct, frozen=True):
    """The relevant part of one step of the run."""

    time_s: float
    tip_mm: tuple[float, float] | None
    theta_deg: float
    retina_mm: float
    is_near: bool
    command: HapticCommand


class _Movement(Struct, frozen=True):
    """A movement with the tip visible, evenly sampled, and low-pass filtered except for `raw_mm`."""

    rate_hz: float
    time_s: Floats
    raw_mm: Floats
    tip_mm: Floats
    theta_deg: Floats
    retina_mm: Floats
    is_near: NDArray[np.bool_]


def measure_recording(path: str | Path) -> dict[str, float | int | str]:
    """Measure a recorded trial.

    Raises:
        BadInput: If it cannot be read, was interrupted, or lacks steps.
    """
    reader = RunReader(path)
    if not reader.is_whole:
        raise BadInput("was interrupted, so it is no trial; complete it with `haptigraph recover`", path)
    if reader.losses is not None:
        raise BadInput("was recovered from a damaged recording and lacks steps, so it is no trial", path)
    procedure = parse_procedure(reader.info.procedure, f"procedure in {path}")
    config: dict[str, Any] = msgspec.json.decode(reader.info.config)
    haptics = config.get("haptics", {})
    has_haptics = haptics.get("max_amplitude", 1.0) > 0
    steps = (step for _, step in reader.records(images=()))
    measures = measure_trial(
        steps, [state.name for state in procedure.states], has_haptics=has_haptics, span=procedure.span
    )
    if measures and haptics.get("weakest_amplitude") is not None:
        measures["weakest_amplitude"] = haptics["weakest_amplitude"]
    if measures and haptics.get("sham_seed") is not None:
        measures["touch"] = "sham"
        measures.pop("reaction_ms", None)  # the onset of a sham is no cue
    return measures


def measure_trial(
    steps: Iterable[Step],
    states: Iterable[str] = (),
    *,
    has_haptics: bool = True,
    span: RunSpan | None = None,
) -> dict[str, float | int | str]:
    """Measure a trial.

    Args:
        steps: All steps of the trial, in order.
        states: States of the procedure; those that did not occur have a time of 0.
        has_haptics: Whether haptic output was enabled.
        span: Start and end of the run; None: those of the paper.

    Returns:
        Measures by name; empty if no run started.
    """
    run, samples = RunMeasures(span=span or RunSpan()), list[_Sample]()
    for step in steps:
        has_ended = run.ended_ns is not None
        run.add(step)
        if run.started_ns is not None and not has_ended:
            samples.append(_sample(step))
    if not samples:
        return {}
    movements = list(_movements(samples))
    measures: dict[str, float | int | str | None] = {
        "completion_s": run.completion_s,
        "mean_theta_deg": run.mean_theta_deg,
        "contacts": run.contacts,
        "state_order": ">".join(run.order),
        "vibrating_s": _vibrating_s(samples) if has_haptics else 0.0,
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
        is_near=any(edge in step.graph for edge in NEAR_RETINA),
        command=step.command,
    )


def _movements(samples: list[_Sample]) -> Iterator[_Movement]:
    """Split a run at long gaps in the tip's detection, and resample each part evenly at the median rate."""
    detected = [sample for sample in samples if sample.tip_mm is not None]
    times_s = np.array([sample.time_s for sample in samples])
    if len(detected) < MIN_SAMPLES:
        return
    rate_hz = 1 / float(np.median(np.diff(times_s)))
    cuts = np.flatnonzero(np.diff([sample.time_s for sample in detected]) > MAX_GAP_S) + 1
    for start, end in zip([0, *cuts], [*cuts, len(detected)], strict=True):
        if end - start >= MIN_SAMPLES:
            yield _movement(detected[start:end], rate_hz)


def _movement(samples: list[_Sample], rate_hz: float) -> _Movement:
    time_s = np.array([sample.time_s for sample in samples])
    even_s = np.arange(time_s[0], time_s[-1] + 0.5 / rate_hz, 1 / rate_hz)

    def resampled(values: list[float]) -> Floats:
        even: Floats = np.interp(even_s, time_s, values)
        return even

    raw_mm = np.column_stack(
        [resampled([sample.tip_mm[axis] for sample in samples if sample.tip_mm]) for axis in (0, 1)]
    )
    return _Movement(
        rate_hz=rate_hz,
        time_s=even_s,
        raw_mm=raw_mm,
        tip_mm=low_passed(raw_mm, rate_hz),
        theta_deg=low_passed(resampled([sample.theta_deg for sample in samples]), rate_hz),
        retina_mm=low_passed(resampled([sample.retina_mm for sample in samples]), rate_hz),
        is_near=resampled([float(sample.is_near) for sample in samples]) > 0.5,
    )


def _motion(movements: list[_Movement]) -> dict[str, float | None]:
    """Return path length, smoothness, tremor and approach speed.

    Path length and tremor cover all movements. Smoothness is defined for a single movement, so it is None
    after a long gap. Approach speed is the maximum of -d(distance to the retina)/dt while the tip is
    approaching or touching it, by the procedure's own relations; at least 0.
    """
    whole = movements[0] if len(movements) == 1 else None
    speeds = speed(whole.tip_mm, whole.rate_hz) if whole else np.empty(0)
    powers = [(band_power(each.raw_mm, each.rate_hz), len(each.time_s)) for each in movements]
    measured = [(power, count) for power, count in powers if power is not None]
    towards = [
        (-np.gradient(each.retina_mm, 1 / each.rate_hz)[each.is_near]).max(initial=0.0)
        for each in movements
        if each.is_near.any() and np.isfinite(each.retina_mm).all()
    ]
    return {
        "path_mm": sum(path_length(each.tip_mm) for each in movements) if movements else None,
        "sparc": sparc(speeds, whole.rate_hz) if whole else None,
        "log_jerk": log_dimensionless_jerk(speeds, whole.rate_hz) if whole else None,
        "tremor_power_mm2": sum(p * n for p, n in measured) / sum(n for _, n in measured)
        if measured
        else None,
        "approach_speed_mm_s": float(max(towards)) if towards else None,
    }


def _vibrating_s(samples: list[_Sample]) -> float:
    """Return the time with a commanded amplitude above 0; the guard may have limited it."""
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
    """Return the median time from a cue to the onset of its correction.

    A cue is the onset of a continuous vibration after silence, as the procedure commands it; where haptic
    output is off, it is the moment of that command, so that conditions are comparable. A correction starts
    when theta decreases by 1 deg/s or more for 0.1 s (a velocity threshold, as usual for movement onsets).
    Cues are excluded if theta was already decreasing or decreased within 0.1 s, faster than people react
    (the limit for false starts in athletics), or did not decrease within 2 s.
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
    is_falling = np.gradient(movement.theta_deg, 1 / movement.rate_hz) <= -MIN_FALL_DEG_S
    min_samples = max(1, round(MIN_FALL_S * movement.rate_hz))
    first = int(np.searchsorted(movement.time_s, cue_s))
    for index in range(first, len(is_falling) - min_samples + 1):
        since_s = float(movement.time_s[index]) - cue_s
        if since_s > MAX_REACTION_S:
            return None
        if is_falling[index : index + min_samples].all():
            return since_s if since_s >= MIN_REACTION_S else None
    return None
