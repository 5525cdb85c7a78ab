"""Check what every message must fulfil: publishers, frames, numbers, units."""

from collections.abc import Iterator

import numpy as np

from haptigraph.findings import Finding
from haptigraph.robot.checking.recorded import Recorded, Series
from haptigraph.robot.ros.poses import MAX_REACH_MM

__all__ = ["MAX_SPEED_M_S", "message_findings"]

MAX_SPEED_M_S = 2.0
"""Of a tool that is moved by hand; faster: other units, or poses that jump."""
UNIT_TOLERANCE = 1e-3


def message_findings(recorded: Recorded) -> Iterator[Finding]:
    """Yield the problems of single messages."""
    yield from _publishers(recorded)
    yield from _frames(recorded)
    yield from _numbers(recorded)
    for problem, count in recorded.rejected.items():
        yield Finding("undecodable", f"{count} messages could not be decoded ({problem})")


def _publishers(recorded: Recorded) -> Iterator[Finding]:
    senders = {"measured_cp": recorded.poses.senders, "operating_state": recorded.state_senders}
    for topic, counted in senders.items():
        if len(counted) > 1:
            yield Finding(
                "two_publishers",
                f"{len(counted)} publishers send on {topic}; exactly one is valid, so stop the others",
            )


def _frames(recorded: Recorded) -> Iterator[Finding]:
    frames = sorted(recorded.poses.frame_ids)
    if "" in frames:
        yield Finding(
            "frame_missing",
            "measured_cp has messages with an empty frame_id; the name of the robot's base is valid",
        )
    if len(frames) > 1:
        yield Finding(
            "frame_changes", f"measured_cp is in the frames {', '.join(map(repr, frames))}; one is valid"
        )
    others: dict[str, Series] = {"measured_cv": recorded.twists, "measured_cf": recorded.wrenches}
    for topic, series in others.items():
        if len(series) and set(series.frame_ids) != set(frames):
            found = ", ".join(map(repr, sorted(series.frame_ids)))
            yield Finding(
                "frames_differ",
                f"{topic} is in {found}, measured_cp in {', '.join(map(repr, frames))}; the same is valid",
            )


def _numbers(recorded: Recorded) -> Iterator[Finding]:
    every = {
        "measured_cp": recorded.poses,
        "measured_cv": recorded.twists,
        "measured_cf": recorded.wrenches,
        "measured_js": recorded.joints,
    }
    for topic, series in every.items():
        numbers = series.samples().numbers
        if bad := int((~np.isfinite(numbers)).any(axis=1).sum()):
            yield Finding(
                "not_finite",
                f"{bad} of {len(numbers)} messages of {topic} have numbers that are not finite; all must be",
            )
    poses = recorded.poses.samples().numbers
    poses = poses[np.isfinite(poses).all(axis=1)]
    if not len(poses):
        return
    lengths = np.linalg.norm(poses[:, 3:], axis=1)
    if (np.abs(lengths - 1) > UNIT_TOLERANCE).any():
        worst = lengths[np.abs(lengths - 1).argmax()]
        yield Finding("quaternion_length", f"measured_cp has a quaternion of length {worst:.4g}; 1 is valid")
    reach_m = float(np.abs(poses[:, :3]).max())
    if reach_m > MAX_REACH_MM / 1e3:
        yield Finding(
            "units",
            f"measured_cp has the tool {reach_m:.4g} m from the base; at most {MAX_REACH_MM / 1e3:g} m is "
            "valid: are positions in millimetres?",
        )
