"""Check the clocks of a recording: images against robot and hand, command against touch; correct a copy."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.analysis.metrics.replay import recorded_registration
from haptigraph.analysis.robot.lag import Lag, estimate_lag, median_interval
from haptigraph.analysis.robot.recorded import recorded_hand, recorded_motion
from haptigraph.errors import BadInput
from haptigraph.messages import Capture, RobotSample, Step
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import RunWriter

__all__ = ["TOLERATED_MS", "SyncReport", "TouchLag", "check_sync", "correct", "robot_note", "sync_lines"]

TOLERATED_MS = 10.0
"""Largest lag that the comparison of tips allows for: two standard deviations of `robot.timing_sd_ms`."""
NS_PER_S = 1e9
NS_PER_MS = 1e6
LONGEST_TOUCH_MS = 500.0
FEWEST_TOUCHES = 8


class TouchLag(Struct, frozen=True):
    """How long after a command an output confirmed that it vibrates."""

    median_ms: float
    interval_ms: tuple[float, float]
    """Of the median, at least 95 %."""
    longest_ms: float
    count: int


class SyncReport(Struct, frozen=True):
    """The clocks of one recording."""

    robot: Lag | None
    """None if no robot was recorded."""
    hand: Lag | None
    """How much later than the tip the hand moved that led it: normally below 0; None if it is not known."""
    hand_problem: str
    """Why the hand's lag is not known; empty if it is, or no hand is recorded."""
    touch: TouchLag | None
    """None if fewer than 8 onsets of vibration were confirmed."""
    shifted: str
    """What was corrected before; empty: nothing."""

    @property
    def is_robot_aligned(self) -> bool:
        """Whether camera and robot agree to within what is tolerated, as far as can be known."""
        return self.robot is None or _is_aligned(self.robot)

    @property
    def is_hand_first(self) -> bool:
        """Whether the tip follows the hand; if it certainly moves before it, their clocks disagree."""
        return self.hand is None or self.hand.interval_s[0] <= TOLERATED_MS / 1e3


def check_sync(path: str | Path) -> SyncReport:
    """Estimate the lags of a recording.

    Raises:
        BadInput: If it has neither robot nor hand, too little motion, or a lag is ambiguous.
    """
    reader = RunReader(path)
    has_robot, has_hand = _moved_by(reader)
    robot = estimate_lag(recorded_motion(reader).motion, str(path)) if has_robot or not has_hand else None
    hand, problem = None, ""
    if has_hand:
        try:
            hand = estimate_lag(recorded_hand(reader), str(path), mover="hand")
        except BadInput as refusal:
            if robot is None:
                raise
            problem = refusal.problem
    return SyncReport(robot, hand, problem, _touch_lag(reader), reader.info.robot_shift)


def robot_note(path: str | Path) -> str:
    """Return a sentence on whether a recorded robot is aligned with the images, as far as that is known."""
    try:
        lag = estimate_lag(recorded_motion(RunReader(path)).motion, str(path))
    except BadInput as refusal:
        return f"whether the clocks of robot and camera agree is not known: {refusal.problem}"
    low, high = (1e3 * one for one in lag.interval_s)
    found = f"{1e3 * lag.lag_s:+.0f} ms from the images (95 % interval {low:+.0f} to {high:+.0f} ms)"
    if _is_aligned(lag):
        return f"the robot's poses are stamped {found}: aligned, as far as the interval says"
    return (
        f"the robot's poses are stamped {found}, so comparisons of the two are wrong; "
        "haptigraph sync-check --correct moves them"
    )


def _is_aligned(lag: Lag) -> bool:
    """Return whether a lag is within what is tolerated, as far as can be known."""
    low, high = lag.interval_s
    drifted_ms = 1e3 * abs(lag.drift_s_per_s) * lag.duration_s / 2
    is_drifted = lag.is_drift_significant and drifted_ms > TOLERATED_MS
    return low <= TOLERATED_MS / 1e3 and high >= -TOLERATED_MS / 1e3 and not is_drifted


def _moved_by(reader: RunReader) -> tuple[bool, bool]:
    """Return whether a robot, and whether a hand is recorded."""
    has_robot = has_hand = False
    for capture, _ in reader.records(images=()):
        has_robot |= bool(capture.robot)
        has_hand |= capture.hand is not None and capture.hand.engaged
        if has_robot and has_hand:
            break
    return has_robot, has_hand


def sync_lines(report: SyncReport) -> Iterator[str]:
    """Yield a report as lines of text."""
    if report.robot is not None:
        yield from _robot_lines(report.robot)
    if report.hand is not None:
        lag, (low, high) = report.hand, report.hand.interval_s
        when = "after" if lag.lag_s <= 0 else "before"
        yield (
            f"hand            the tip moves {1e3 * abs(lag.lag_s):.1f} ms {when} the hand that leads it, "
            f"95 % interval {-1e3 * high:+.1f} to {-1e3 * low:+.1f} ms; the hand explains "
            f"{100 * lag.explained_share:.2f} % of the motion in {lag.images} images"
        )
    elif report.hand_problem:
        yield f"hand            not known: {report.hand_problem}"
    if report.touch is not None:
        touch = report.touch
        (soon, late), count = touch.interval_ms, touch.count
        yield (
            f"touch           {touch.median_ms:.1f} ms after its command (median of {count}, 95 % interval "
            f"{soon:.1f} to {late:.1f} ms), at most {touch.longest_ms:.1f} ms"
        )
    else:
        yield "touch           not checked: fewer than 8 onsets of vibration were confirmed"
    if report.shifted:
        yield f"before          {report.shifted}"


def _robot_lines(lag: Lag) -> Iterator[str]:
    low, high = lag.interval_s
    when = "later" if lag.lag_s >= 0 else "earlier"
    yield (
        f"robot           poses are stamped {1e3 * abs(lag.lag_s):.1f} ms {when} than images; lag "
        f"{1e3 * lag.lag_s:+.1f} ms, 95 % interval {1e3 * low:+.1f} to {1e3 * high:+.1f} ms"
    )
    drift, (slow, fast) = (1e3 * lag.drift_s_per_s, [1e3 * one for one in lag.drift_interval_s_per_s])
    yield f"drift           {drift:+.3f} ms/s, 95 % interval {slow:+.3f} to {fast:+.3f} ms/s"
    yield (
        f"from            {lag.images} images in {lag.duration_s:.1f} s; the robot explains "
        f"{100 * lag.explained_share:.2f} % of the motion, residual {lag.residual_mm:.3f} mm per axis"
    )


def correct(path: str | Path, output: str | Path, lag: Lag) -> str:
    """Write a copy of a recording whose robot samples are moved to when they were measured.

    Each sample goes to the first image that is not earlier. What was concluded during the run stays; a replay
    shows what would have been concluded.

    Args:
        path: The recording.
        output: The copy; it must not exist.
        lag: How late the robot's stamps are.

    Returns:
        What the copy's header says of it.

    Raises:
        BadInput: If a file cannot be read or written, or images are missing.
    """
    reader = RunReader(path)
    if reader.count()[1]:
        raise BadInput("images are missing in it, so a copy would not replay", path)
    start_ns = next(capture.stamp_ns for capture, _ in reader.records(images=()))
    samples = sorted(
        (_moved(one, lag, start_ns) for capture, _ in reader.records(images=()) for one in capture.robot),
        key=lambda one: one.stamp_ns,
    )
    moved_ms, per_s = -1e3 * lag.lag_s, -1e3 * lag.drift_s_per_s
    sentence = f"the robot's stamps were moved by {moved_ms:+.2f} ms and {per_s:+.4f} ms/s"
    procedure = assemble.parse_procedure(reader.info.procedure, f"procedure in {reader.path}")
    info = replace(reader.info, robot_shift=sentence, decoder="")
    writer = RunWriter(output, info, recorded_registration(reader).image, procedure.schema.measure_names)
    try:
        for capture, step in _regrouped(reader, samples):
            writer.write(capture, step)
        writer.close()
    except BaseException:
        writer.discard()
        raise
    return sentence


def _regrouped(reader: RunReader, samples: list[RobotSample]) -> Iterator[tuple[Capture, Step]]:
    first = 0
    for capture, step in reader.records():
        last = first
        while last < len(samples) and samples[last].stamp_ns <= capture.stamp_ns:
            last += 1
        yield replace(capture, robot=tuple(samples[first:last])), step
        first = last


def _moved(sample: RobotSample, lag: Lag, start_ns: int) -> RobotSample:
    """Return a sample with the stamp at which an image shows its pose."""
    stamped_s = (sample.stamp_ns - start_ns) / NS_PER_S
    at_s = (stamped_s - lag.lag_s + lag.drift_s_per_s * lag.middle_s) / (1 + lag.drift_s_per_s)
    return replace(sample, stamp_ns=start_ns + round(at_s * NS_PER_S))


def _touch_lag(reader: RunReader) -> TouchLag | None:
    commands, confirmed = list[int](), list[int]()
    was_off, until_ns = True, 0
    for capture, step in reader.records(images=()):
        is_off = step.command.pattern.kind == "off"
        if was_off and not is_off and step.timing is not None:
            commands.append(step.timing.commanded_ns)
        was_off = is_off
        for one in sorted(capture.delivered, key=lambda each: each.start_ns):
            if one.start_ns > until_ns:
                confirmed.append(one.start_ns)
            until_ns = max(until_ns, one.end_ns)
    starts = np.array(sorted(confirmed))
    delays_ms = [
        float(starts[at] - command) / NS_PER_MS
        for command in commands
        if (at := int(np.searchsorted(starts, command))) < len(starts)
    ]
    delays_ms = sorted(one for one in delays_ms if one <= LONGEST_TOUCH_MS)
    if len(delays_ms) < FEWEST_TOUCHES:
        return None
    return TouchLag(float(np.median(delays_ms)), median_interval(delays_ms), delays_ms[-1], len(delays_ms))
