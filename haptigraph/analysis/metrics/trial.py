"""All measures of one trial, from its steps or its recording, by the names of the study's data dictionary.

They cover exactly the run: from the tip's first entry into the globe to the first Target Hit, or to the end
of the trial if there was none. Measures that cannot be determined are omitted. `run`, `motion` and
`data_quality` have the formulas that are not documented here.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import Struct

from haptigraph.analysis.metrics.data_quality import LONG_GAP_NS, DataQuality
from haptigraph.analysis.metrics.motion import MAX_SPARC_HZ, log_dimensionless_jerk, path_length, sparc, speed
from haptigraph.analysis.metrics.movement import (
    MOVEMENT_HZ,
    RATE_TOLERANCE,
    Detection,
    Movement,
    movements_of,
    tremor_power,
)
from haptigraph.analysis.metrics.replay import recorded_procedure
from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.errors import BadInput
from haptigraph.geometry import Point
from haptigraph.graph import Triplet
from haptigraph.haptics.observed_device import confirms
from haptigraph.haptics.pattern import vibrating_ns
from haptigraph.inference.span import RunSpan
from haptigraph.messages import Delivered, HapticCommand, Step
from haptigraph.recording.reader import RunReader

__all__ = ["measure_recording", "measure_trial"]

NEAR = ("approaching", "touching")
MIN_FALL_DEG_S = 1.0
"""A correction reduces theta at least this fast ..."""
MIN_FALL_S = 0.1
"""... for this long."""
MIN_REACTION_S, MAX_REACTION_S = 0.1, 2.0
"""An earlier correction began before the cue; a later one is not attributed to it."""


class _Sample(Struct, frozen=True):
    """The relevant part of one step of the run."""

    time_s: float
    command: HapticCommand
    tip: Detection | None
    """None: it is not visible."""


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
    procedure = recorded_procedure(reader)
    config: dict[str, Any] = msgspec.json.decode(reader.info.config)
    haptics = config.get("haptics", {})
    has_haptics = haptics.get("max_amplitude", 1.0) > 0
    delivered: list[Delivered] = []

    def steps() -> Iterator[Step]:
        for capture, step in reader.records(images=()):
            delivered.extend(capture.delivered)
            yield step

    states = [state.name for state in procedure.states]
    output = config.get("trial", {}).get("touch_output", "")
    touch = delivered if confirms(output) else None
    measures = measure_trial(steps(), states, has_haptics=has_haptics, span=procedure.span, delivered=touch)
    if measures and output:
        measures["touch_output"] = output
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
    delivered: Sequence[Delivered] | None = None,
) -> dict[str, float | int | str]:
    """Measure a trial.

    Args:
        steps: All steps of the trial, in order.
        states: States of the procedure; those that did not occur have a time of 0.
        has_haptics: Whether haptic output was enabled.
        span: Start and end of the run; None: those of the paper.
        delivered: Vibration that an output confirmed, complete once all steps are read; None: no output of
            this trial confirms any.

    Returns:
        Measures by name; only those of the data quality, over the whole trial, if no run started.
    """
    run, samples = RunMeasures(span=span or RunSpan()), list[_Sample]()
    quality = DataQuality(run)
    for step in steps:
        has_ended = run.ended_ns is not None
        run.add(step)
        quality.add(step)
        if run.started_ns is not None and not has_ended:
            samples.append(_sample(step, run.span.begins[0]))
    if not samples:
        return {**quality.measures()}
    detections = [sample.tip for sample in samples if sample.tip is not None]
    movements = movements_of(detections)
    is_whole = quality.longest_gap_ns() <= LONG_GAP_NS
    measures: dict[str, float | int | str | None] = {
        "completion_s": run.completion_s,
        "mean_theta_deg": run.mean_theta_deg,
        "contacts": run.contacts,
        "state_order": ">".join(run.order),
        "vibrating_s": _vibrating_s(samples) if has_haptics else 0.0,
        "delivered_s": None if delivered is None else _delivered_s(samples, delivered),
        "reaction_ms": _reaction_ms(samples, movements),
        "tremor_power_mm2": tremor_power(detections),
        **_motion(movements, is_whole=is_whole),
        **quality.measures(),
    }
    measures |= {
        f"time_{state}_s": run.state_s.get(state, 0.0) for state in dict.fromkeys([*states, *run.state_s])
    }
    return {name: value for name, value in measures.items() if value is not None}


def _sample(step: Step, name: str) -> _Sample:
    tip, measures, detection = step.observation.found.get(name), step.graph.measures, None
    if isinstance(tip, Point):
        detection = Detection(
            stamp_ns=step.stamp_ns,
            tip_mm=tip.at_mm,
            theta_deg=measures.get("theta_deg", np.nan),
            retina_mm=measures.get("distance_to_retina_mm", np.nan),
            is_near=any(Triplet(name, predicate, "retina_surface") in step.graph for predicate in NEAR),
        )
    return _Sample(step.stamp_ns / 1e9, step.command, detection)


def _motion(movements: list[Movement], *, is_whole: bool) -> dict[str, float | None]:
    """Return path length, smoothness and approach speed.

    Path length and smoothness are those of one movement from start to end of the run, so they are None after
    a long gap. Smoothness covers frequencies up to 10 Hz, so it is None below 20 images/s. Approach speed is
    the maximum of -d(distance to the retina)/dt while the tip is approaching or touching it, by the
    procedure's own relations, over all movements; at least 0.
    """
    whole = movements[0] if movements and is_whole else None
    has_band = whole is not None and whole.images_per_s >= RATE_TOLERANCE * 2 * MAX_SPARC_HZ
    speeds = speed(whole.tip_mm, MOVEMENT_HZ) if whole and has_band else np.empty(0)
    towards = [
        (-np.gradient(each.retina_mm, 1 / MOVEMENT_HZ)[each.is_near]).max(initial=0.0)
        for each in movements
        if each.is_near.any() and np.isfinite(each.retina_mm).all()
    ]
    return {
        "path_mm": path_length(whole.tip_mm) if whole else None,
        "sparc": sparc(speeds, MOVEMENT_HZ),
        "log_jerk": log_dimensionless_jerk(speeds, MOVEMENT_HZ),
        "approach_speed_mm_s": float(max(towards)) if towards else None,
    }


def _vibrating_s(samples: list[_Sample]) -> float:
    """Return the time with a commanded amplitude above 0; the guard may have limited it."""
    total_ns = sum(
        vibrating_ns(sample.command, sample.command.stamp_ns, after.command.stamp_ns)
        for sample, after in pairwise(samples)
    )
    return total_ns / 1e9


def _delivered_s(samples: list[_Sample], delivered: Sequence[Delivered]) -> float:
    """Return the time of the run within which at least one output confirmed that it vibrated."""
    total_ns, at_ns = 0, samples[0].command.stamp_ns
    end_ns = samples[-1].command.stamp_ns
    for period in sorted(delivered, key=lambda each: each.start_ns):
        start_ns, until_ns = max(period.start_ns, at_ns), min(period.end_ns, end_ns)
        total_ns += max(until_ns - start_ns, 0)
        at_ns = max(at_ns, until_ns)
    return total_ns / 1e9


def _reaction_ms(samples: list[_Sample], movements: list[Movement]) -> float | None:
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


def _reaction_s(movement: Movement, cue_s: float) -> float | None:
    is_falling = np.gradient(movement.theta_deg, 1 / MOVEMENT_HZ) <= -MIN_FALL_DEG_S
    min_samples = round(MIN_FALL_S * MOVEMENT_HZ)
    first = int(np.searchsorted(movement.time_s, cue_s))
    for index in range(first, len(is_falling) - min_samples + 1):
        since_s = float(movement.time_s[index]) - cue_s
        if since_s > MAX_REACTION_S:
            return None
        if is_falling[index : index + min_samples].all():
            return since_s if since_s >= MIN_REACTION_S else None
    return None
